import React from 'react'
import {createRoot} from 'react-dom/client'
import '@mantine/core/styles.css'
import {Accordion, Anchor, Button, Checkbox, Chip, Group, MantineProvider, Menu, MultiSelect, NavLink, NumberInput,
  Pagination, PasswordInput, Radio, Rating, SegmentedControl, Select, Slider, Stack, Stepper, Switch, Tabs, TextInput,
} from '@mantine/core'
createRoot(document.getElementById('app')).render(<MantineProvider><Stack w={800} gap='xs'>
  <Group><Button>Save</Button><Menu><Menu.Target><Button variant='light'>Menu</Button></Menu.Target>
    <Menu.Dropdown><Menu.Item>First</Menu.Item></Menu.Dropdown></Menu><Anchor href='#x'>A link</Anchor>
    <Checkbox label='Agree' /><Switch label='Loud' /><Chip>Vegan</Chip><Rating /></Group>
  <Group><TextInput label='Name' /><PasswordInput label='Secret' w={150} /><NumberInput label='Count' /></Group>
  <Group><Select label='Fruit' data={['Apple', 'Grape']} /><MultiSelect label='Towns' data={['Bonn', 'Kiel']}
    defaultValue={['Bonn']} /><SegmentedControl data={['Day', 'Week']} /></Group>
  <Radio.Group label='Size'><Group><Radio value='s' label='Small' /><Radio value='l' label='Large' /></Group></Radio.Group>
  <Slider w={300} /><Pagination total={4} />
  <Tabs defaultValue='one'><Tabs.List><Tabs.Tab value='one'>One</Tabs.Tab><Tabs.Tab value='two'>Two</Tabs.Tab>
    </Tabs.List></Tabs>
  <Accordion><Accordion.Item value='a'><Accordion.Control>More</Accordion.Control><Accordion.Panel>Inside
    </Accordion.Panel></Accordion.Item></Accordion>
  <NavLink label='Inbox'><NavLink label='Deep' /></NavLink>
  <Stepper active={0} onStepClick={() => {}}><Stepper.Step label='Start' /><Stepper.Step label='End' /></Stepper>
</Stack></MantineProvider>)

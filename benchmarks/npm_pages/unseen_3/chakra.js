import React from 'react'
import {createRoot} from 'react-dom/client'
import {Accordion, Button, ChakraProvider, Checkbox, CloseButton, Editable, Field, HStack, Input, Menu, NativeSelect, NumberInput, PinInput, Portal, RadioGroup,
  RatingGroup, SegmentGroup, Slider, Stack, Switch, Table, Tabs, Tag, defaultSystem} from '@chakra-ui/react'
const people = [['Ann', 30], ['Ben', 25], ['Cleo', 41]]
const App = () => {
  const [chosen, choose] = React.useState([])
  return <ChakraProvider value={defaultSystem}><Stack width='900px' padding='4' gap='3'>
    <HStack><Button onClick={() => choose(['Ann'])}>Save</Button><Button variant='outline' disabled>Send</Button><CloseButton onClick={() => choose([])} />
      <Menu.Root><Menu.Trigger asChild><Button variant='outline'>Open</Button></Menu.Trigger><Portal><Menu.Positioner><Menu.Content><Menu.Item value='new'>New file</Menu.Item><Menu.Item value='open'>Open file</Menu.Item></Menu.Content></Menu.Positioner></Portal></Menu.Root>
      <Checkbox.Root><Checkbox.HiddenInput /><Checkbox.Control /><Checkbox.Label>Agree</Checkbox.Label></Checkbox.Root>
      <Switch.Root><Switch.HiddenInput /><Switch.Control /><Switch.Label>Loud</Switch.Label></Switch.Root>
      <RadioGroup.Root defaultValue='s'><HStack>{['s', 'l'].map((size) => <RadioGroup.Item key={size} value={size}><RadioGroup.ItemHiddenInput /><RadioGroup.ItemIndicator /><RadioGroup.ItemText>{size}</RadioGroup.ItemText></RadioGroup.Item>)}</HStack></RadioGroup.Root></HStack>
    <HStack><Field.Root><Field.Label>Name</Field.Label><Input placeholder='Name' /></Field.Root><NumberInput.Root defaultValue='3'><NumberInput.Control /><NumberInput.Input /></NumberInput.Root>
      <NativeSelect.Root><NativeSelect.Field><option>Apple</option><option>Grape</option></NativeSelect.Field><NativeSelect.Indicator /></NativeSelect.Root></HStack>
    <HStack><PinInput.Root><PinInput.HiddenInput /><PinInput.Control>{[0, 1, 2, 3].map((i) => <PinInput.Input key={i} index={i} />)}</PinInput.Control></PinInput.Root>
      <RatingGroup.Root count={5} defaultValue={3}><RatingGroup.HiddenInput /><RatingGroup.Control /></RatingGroup.Root>
      <SegmentGroup.Root defaultValue='Day'><SegmentGroup.Indicator /><SegmentGroup.Items items={['Day', 'Week', 'Month']} /></SegmentGroup.Root>
      <Tag.Root><Tag.Label>Vegan</Tag.Label><Tag.EndElement><Tag.CloseTrigger onClick={() => choose(['Ben'])} /></Tag.EndElement></Tag.Root></HStack>
    <Slider.Root defaultValue={[40]} width='300px'><Slider.Label>Volume</Slider.Label><Slider.Control><Slider.Track><Slider.Range /></Slider.Track><Slider.Thumbs /></Slider.Control></Slider.Root>
    <Tabs.Root defaultValue='a'><Tabs.List><Tabs.Trigger value='a'>One</Tabs.Trigger><Tabs.Trigger value='b'>Two</Tabs.Trigger></Tabs.List><Tabs.Content value='a'>First</Tabs.Content><Tabs.Content value='b'>Second</Tabs.Content></Tabs.Root>
    <Accordion.Root collapsible>{['Size', 'Price'].map((item) => <Accordion.Item key={item} value={item}><Accordion.ItemTrigger>{item}<Accordion.ItemIndicator /></Accordion.ItemTrigger><Accordion.ItemContent><Accordion.ItemBody>Inside</Accordion.ItemBody></Accordion.ItemContent></Accordion.Item>)}</Accordion.Root>
    <Editable.Root defaultValue='Click to edit'><Editable.Preview /><Editable.Input /></Editable.Root>
    <Table.Root size='sm' interactive><Table.Header><Table.Row><Table.ColumnHeader /><Table.ColumnHeader>Name</Table.ColumnHeader><Table.ColumnHeader>Age</Table.ColumnHeader></Table.Row></Table.Header>
      <Table.Body>{people.map(([name, age]) => <Table.Row key={name}><Table.Cell><Checkbox.Root aria-label={'Select ' + name} checked={chosen.includes(name)} onCheckedChange={({checked}) => choose(checked ? [...chosen, name] : chosen.filter((one) => one !== name))}><Checkbox.HiddenInput /><Checkbox.Control /></Checkbox.Root></Table.Cell><Table.Cell>{name}</Table.Cell><Table.Cell>{age}</Table.Cell></Table.Row>)}</Table.Body></Table.Root>
  </Stack></ChakraProvider>
}
createRoot(document.getElementById('app')).render(<App />)

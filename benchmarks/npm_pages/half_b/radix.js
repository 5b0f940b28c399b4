import React from 'react'
import {createRoot} from 'react-dom/client'
import {Accordion, Checkbox, Collapsible, ContextMenu, DropdownMenu, Label, Menubar, NavigationMenu, RadioGroup, Select,
  Slider, Switch, Tabs, Toggle, ToggleGroup} from 'radix-ui'
const look = {border: '1px solid gray', minWidth: 20, minHeight: 20}
createRoot(document.getElementById('app')).render(<>
  <Menubar.Root style={{display: 'flex'}}>{['File', 'Edit'].map((name) => <Menubar.Menu key={name}>
    <Menubar.Trigger>{name}</Menubar.Trigger><Menubar.Portal><Menubar.Content><Menubar.Item>New</Menubar.Item>
    </Menubar.Content></Menubar.Portal></Menubar.Menu>)}</Menubar.Root>
  <NavigationMenu.Root><NavigationMenu.List><NavigationMenu.Item><NavigationMenu.Trigger>Learn</NavigationMenu.Trigger>
    <NavigationMenu.Content>Much</NavigationMenu.Content></NavigationMenu.Item><NavigationMenu.Item>
    <NavigationMenu.Link href='#x'>News</NavigationMenu.Link></NavigationMenu.Item></NavigationMenu.List>
  </NavigationMenu.Root>
  <Checkbox.Root id='c' style={look}><Checkbox.Indicator>x</Checkbox.Indicator></Checkbox.Root>
  <Label.Root htmlFor='c'>Agree</Label.Root> <Switch.Root style={{...look, width: 40}} aria-label='Loud'>
    <Switch.Thumb style={{...look, display: 'block'}} /></Switch.Root>
  <RadioGroup.Root aria-label='Size'>{['Small', 'Large'].map((name) => <label key={name}>
    <RadioGroup.Item value={name} style={look}><RadioGroup.Indicator>o</RadioGroup.Indicator></RadioGroup.Item>
    {name}</label>)}</RadioGroup.Root>
  <Slider.Root defaultValue={[30]} style={{position: 'relative', display: 'flex', width: 300, height: 30}}>
    <Slider.Track style={{background: 'silver', flexGrow: 1, height: 9}}><Slider.Range /></Slider.Track>
    <Slider.Thumb style={{...look, display: 'block'}} aria-label='Volume' /></Slider.Root>
  <Tabs.Root defaultValue='One'><Tabs.List><Tabs.Trigger value='One'>One</Tabs.Trigger>
    <Tabs.Trigger value='Two'>Two</Tabs.Trigger></Tabs.List><Tabs.Content value='One'>First</Tabs.Content></Tabs.Root>
  <Accordion.Root type='single' collapsible><Accordion.Item value='a'><Accordion.Header><Accordion.Trigger>More
    </Accordion.Trigger></Accordion.Header><Accordion.Content>Inside</Accordion.Content></Accordion.Item></Accordion.Root>
  <Select.Root><Select.Trigger aria-label='Fruit'><Select.Value placeholder='Choose' /></Select.Trigger><Select.Portal>
    <Select.Content><Select.Item value='a'><Select.ItemText>Apple</Select.ItemText></Select.Item></Select.Content>
  </Select.Portal></Select.Root>
  <DropdownMenu.Root><DropdownMenu.Trigger>Options</DropdownMenu.Trigger><DropdownMenu.Portal><DropdownMenu.Content>
    <DropdownMenu.Item>Copy</DropdownMenu.Item></DropdownMenu.Content></DropdownMenu.Portal></DropdownMenu.Root>
  <Toggle.Root aria-label='Bold'>B</Toggle.Root>
  <ToggleGroup.Root type='single'><ToggleGroup.Item value='l'>Left</ToggleGroup.Item>
    <ToggleGroup.Item value='r'>Right</ToggleGroup.Item></ToggleGroup.Root>
  <Collapsible.Root><Collapsible.Trigger>Show</Collapsible.Trigger><Collapsible.Content>Hidden</Collapsible.Content>
  </Collapsible.Root>
  <ContextMenu.Root><ContextMenu.Trigger style={{...look, display: 'inline-block', padding: 9}}>Press right
  </ContextMenu.Trigger><ContextMenu.Portal><ContextMenu.Content>Cut</ContextMenu.Content></ContextMenu.Portal>
  </ContextMenu.Root>
</>)

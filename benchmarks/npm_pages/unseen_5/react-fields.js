import React from 'react'
import {createRoot} from 'react-dom/client'
import Select from 'react-select'
import CreatableSelect from 'react-select/creatable'
import DatePicker from 'react-datepicker'
import Tree from 'rc-tree'
import {Disclosure, DisclosureButton, DisclosurePanel, Listbox, ListboxButton, ListboxOption, ListboxOptions, Menu, MenuButton, MenuItem, MenuItems, Radio, RadioGroup, Switch, Tab, TabGroup, TabList, TabPanel, TabPanels} from '@headlessui/react'
const fruits = ['Apple', 'Grape', 'Pear'].map((name) => ({value: name, label: name}))
const App = () => {
  const [date, setDate] = React.useState(new Date(2026, 2, 10))
  const [on, setOn] = React.useState(false)
  const [plan, setPlan] = React.useState('Small')
  const [person, setPerson] = React.useState('Ada')
  return <>
    <div style={{display: 'flex', gap: 20}}><div style={{width: 300}}><Select options={fruits} isClearable defaultValue={fruits[0]} /></div><div style={{width: 360}}><CreatableSelect isMulti options={fruits} defaultValue={fruits.slice(0, 2)} /></div></div>
    <div style={{display: 'flex', gap: 20, marginTop: 20}}><DatePicker inline selected={date} onChange={setDate} showMonthDropdown dropdownMode='select' minDate={new Date(2026, 2, 3)} /><DatePicker selected={date} onChange={setDate} />
      <Tree checkable defaultExpandAll treeData={[{key: '0', title: 'Trunk', children: [{key: '0-0', title: 'Branch'}, {key: '0-1', title: 'Leaf', disabled: true}]}]} /></div>
    <TabGroup><TabList><Tab>One</Tab><Tab>Two</Tab></TabList><TabPanels><TabPanel>First</TabPanel><TabPanel>Second</TabPanel></TabPanels></TabGroup>
    <Switch checked={on} onChange={setOn} style={{width: 60, height: 24, background: on ? 'teal' : '#ccc'}}><span>{on ? 'On' : 'Off'}</span></Switch>
    <RadioGroup value={plan} onChange={setPlan} style={{display: 'flex', gap: 10}}>{['Small', 'Large'].map((name) => <Radio key={name} value={name} style={{padding: 6, border: '1px solid', background: name === plan ? '#cde' : '#fff'}}>{name}</Radio>)}</RadioGroup>
    <Listbox value={person} onChange={setPerson}><ListboxButton>{person}</ListboxButton><ListboxOptions anchor='bottom'>{['Ada', 'Grace'].map((name) => <ListboxOption key={name} value={name}>{name}</ListboxOption>)}</ListboxOptions></Listbox>
    <Menu><MenuButton>Options</MenuButton><MenuItems anchor='bottom'><MenuItem><button>Edit</button></MenuItem></MenuItems></Menu>
    <Disclosure><DisclosureButton>Is it free?</DisclosureButton><DisclosurePanel>Yes</DisclosurePanel></Disclosure>
  </>
}
createRoot(document.getElementById('app')).render(<App />)

import React from 'react'
import {createRoot} from 'react-dom/client'
import {parseDate} from '@internationalized/date'
import {Button, Calendar, CalendarCell, CalendarGrid, Cell, Checkbox, Column, ComboBox, Disclosure, DisclosurePanel, Heading, Input, Label, ListBox, ListBoxItem, Menu, MenuItem, MenuTrigger,
  NumberField, Group, Popover, Radio, RadioGroup, Row, SearchField, Select, SelectValue, Slider, SliderThumb, SliderTrack, Switch, Tab, TabList, TabPanel, Table, TableBody, TableHeader, Tabs, Tag, TagGroup, TagList, ToggleButton} from 'react-aria-components'
const fruits = ['Apple', 'Grape', 'Pear']
const App = () => <div style={{width: 1000}}>
  <Button>Save</Button> <Button isDisabled>Send</Button> <ToggleButton>Pin</ToggleButton> <Checkbox>Agree</Checkbox> <Switch><div className='i' /> Loud</Switch>
  <MenuTrigger><Button>Open</Button><Popover><Menu><MenuItem>New file</MenuItem><MenuItem>Open file</MenuItem></Menu></Popover></MenuTrigger>
  <RadioGroup defaultValue='s'><Label>Size</Label><Radio value='s'>Small</Radio><Radio value='l'>Large</Radio></RadioGroup>
  <div style={{display: 'flex', gap: 12}}>
    <Select><Label>Fruit</Label><Button><SelectValue /> v</Button><Popover><ListBox>{fruits.map((f) => <ListBoxItem key={f}>{f}</ListBoxItem>)}</ListBox></Popover></Select>
    <ComboBox><Label>Town</Label><Input /><Button>v</Button><Popover><ListBox><ListBoxItem>Bonn</ListBoxItem><ListBoxItem>Kiel</ListBoxItem></ListBox></Popover></ComboBox>
    <NumberField defaultValue={3}><Label>Count</Label><Group><Button slot='decrement'>-</Button><Input /><Button slot='increment'>+</Button></Group></NumberField>
    <SearchField defaultValue='x'><Label>Search</Label><Input /><Button>Clear</Button></SearchField></div>
  <Slider defaultValue={30}><Label>Volume</Label><SliderTrack><SliderThumb /></SliderTrack></Slider>
  <div style={{display: 'flex', gap: 30}}>
    <Calendar defaultValue={parseDate('2026-03-10')} minValue={parseDate('2026-03-03')}><header style={{display: 'flex'}}><Button slot='previous'>Back</Button><Heading /><Button slot='next'>Next</Button></header><CalendarGrid>{(date) => <CalendarCell date={date} />}</CalendarGrid></Calendar>
    <div><Tabs><TabList aria-label='Pages'><Tab id='a'>One</Tab><Tab id='b'>Two</Tab></TabList><TabPanel id='a'>First</TabPanel><TabPanel id='b'>Second</TabPanel></Tabs>
      <TagGroup selectionMode='multiple' onRemove={() => {}}><Label>Tags</Label><TagList><Tag id='v'>Vegan <Button slot='remove'>x</Button></Tag><Tag id='h'>Halal <Button slot='remove'>x</Button></Tag></TagList></TagGroup>
      <Disclosure><Heading><Button slot='trigger'>More</Button></Heading><DisclosurePanel>Inside</DisclosurePanel></Disclosure></div>
    <ListBox aria-label='Fruits' selectionMode='multiple'>{fruits.map((f) => <ListBoxItem key={f}>{f}</ListBoxItem>)}</ListBox>
    <Table aria-label='People' selectionMode='multiple' onSortChange={() => {}}><TableHeader><Column isRowHeader allowsSorting>Name</Column><Column>Age</Column></TableHeader><TableBody><Row><Cell>Ann</Cell><Cell>30</Cell></Row><Row><Cell>Ben</Cell><Cell>25</Cell></Row></TableBody></Table></div>
</div>
createRoot(document.getElementById('app')).render(<App />)

import React from 'react'
import {createRoot} from 'react-dom/client'
import {DayPicker} from 'react-day-picker'
import {HexColorInput, HexColorPicker} from 'react-colorful'
import {ReactTags} from 'react-tag-autocomplete'
import {Command} from 'cmdk'
import {Tab, TabList, TabPanel, Tabs} from 'react-tabs'

const countries = ['Belgium', 'France', 'Germany', 'Italy', 'Spain'].map((label, value) => ({value, label}))

const App = () => {
  const [day, setDay] = React.useState(new Date(2026, 2, 10))
  const [range, setRange] = React.useState({from: new Date(2026, 2, 3), to: new Date(2026, 2, 6)})
  const [colour, setColour] = React.useState('#2a9d8f')
  const [tags, setTags] = React.useState(countries.slice(1, 3))
  const [said, say] = React.useState('')
  return <>
    <div style={{display: 'flex', gap: 30}}>
      <DayPicker mode='single' defaultMonth={new Date(2026, 2)} selected={day} onSelect={setDay} footer={day ? day.toDateString() : 'Pick a day.'} />
      <DayPicker mode='range' captionLayout='dropdown' defaultMonth={new Date(2026, 2)} selected={range} onSelect={setRange} disabled={{dayOfWeek: [0]}} showWeekNumber />
      <div><HexColorPicker color={colour} onChange={setColour} /><HexColorInput color={colour} onChange={setColour} prefixed aria-label='Colour' /></div>
    </div>
    <div style={{display: 'flex', gap: 30, marginTop: 20}}>
      <Command label='Commands'><Command.Input placeholder='Type a command...' /><Command.List><Command.Empty>No results found.</Command.Empty><Command.Group heading='Files'><Command.Item onSelect={say}>New file</Command.Item><Command.Item onSelect={say}>Open file</Command.Item></Command.Group><Command.Separator /><Command.Item onSelect={say}>Settings</Command.Item><Command.Item disabled>Print</Command.Item></Command.List></Command>
      <div style={{width: 400}}><ReactTags labelText='Countries' selected={tags} suggestions={countries} onAdd={(tag) => setTags([...tags, tag])} onDelete={(index) => setTags(tags.filter((_, i) => i !== index))} noOptionsText='No such country' /></div>
      <div style={{width: 400}}><Tabs><TabList><Tab>Mario</Tab><Tab>Luigi</Tab><Tab disabled>Peach</Tab><Tab>Yoshi</Tab></TabList><TabPanel><p>The plumber</p></TabPanel><TabPanel><p>The brother</p></TabPanel><TabPanel /><TabPanel><p>The friend</p></TabPanel></Tabs></div>
    </div>
    <p>{said}</p>
  </>
}
createRoot(document.getElementById('app')).render(<App />)

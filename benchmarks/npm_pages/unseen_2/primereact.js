import React, {useState} from 'react'
import {createRoot} from 'react-dom/client'
import {Button} from 'primereact/button'
import {Calendar} from 'primereact/calendar'
import {Checkbox} from 'primereact/checkbox'
import {Column} from 'primereact/column'
import {DataTable} from 'primereact/datatable'
import {Dropdown} from 'primereact/dropdown'
import {InputNumber} from 'primereact/inputnumber'
import {InputSwitch} from 'primereact/inputswitch'
import {InputText} from 'primereact/inputtext'
import {Panel} from 'primereact/panel'
import {Rating} from 'primereact/rating'
import {SelectButton} from 'primereact/selectbutton'
import {Slider} from 'primereact/slider'
import {TabPanel, TabView} from 'primereact/tabview'
import {Tree} from 'primereact/tree'
const App = () => {
  const [all, setAll] = useState({fruit: 'Apple', view: 'Day', volume: 30, stars: 2, keys: {r: true}})
  const set = (more) => setAll({...all, ...more})
  const row = {display: 'flex', gap: 8}
  return <div style={{width: 900}}>
    <div style={row}><Button label='Save' /><Checkbox checked={Boolean(all.agree)} onChange={(e) => set({agree: e.checked})} />
      <InputSwitch checked={Boolean(all.loud)} onChange={(e) => set({loud: e.value})} />
      <SelectButton value={all.view} options={['Day', 'Week']} onChange={(e) => set({view: e.value})} />
      <Rating value={all.stars} onChange={(e) => set({stars: e.value})} /></div>
    <div style={row}><InputText placeholder='Name' /><InputNumber value={3} showButtons />
      <Dropdown value={all.fruit} options={['Apple', 'Grape']} onChange={(e) => set({fruit: e.value})} /></div>
    <Slider value={all.volume} onChange={(e) => set({volume: e.value})} style={{width: 300, margin: 16}} />
    <TabView><TabPanel header='One'>First</TabPanel><TabPanel header='Two'>Second</TabPanel></TabView>
    <div style={row}><Calendar inline value={all.day} viewDate={new Date(2026, 2, 10)} maxDate={new Date(2026, 2, 25)}
      onChange={(e) => set({day: e.value})} onViewDateChange={() => {}} />
      <Tree value={[{key: 'r', label: 'Root', children: [{key: 'l', label: 'Leaf'}]}]} selectionMode='single'
        selectionKeys={all.key} onSelectionChange={(e) => set({key: e.value})} />
      <Panel header='More' toggleable>Inside</Panel></div>
    <DataTable value={[1, 2, 3].map((i) => ({id: i, name: 'Person ' + i, age: 20 + i}))} selectionMode='single' dataKey='id'
      selection={all.person} onSelectionChange={(e) => set({person: e.value})} size='small'>
      <Column field='name' header='Name' sortable /><Column field='age' header='Age' /></DataTable>
  </div>
}
createRoot(document.getElementById('app')).render(<App />)

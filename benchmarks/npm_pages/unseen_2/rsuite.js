import React from 'react'
import {createRoot} from 'react-dom/client'
import {Breadcrumb, Button, Calendar, Checkbox, Input, InputNumber, Nav, Pagination, Panel, Radio, RadioGroup, Rate, SelectPicker,
  Slider, Steps, Tag, Toggle, Tree} from 'rsuite'
const App = () => {
  const [page, setPage] = React.useState(1)
  const [tab, setTab] = React.useState('a')
  const row = {display: 'flex', gap: 8, alignItems: 'center'}
  return <div style={{width: 900}}>
    <div style={row}><Button appearance='primary'>Save</Button><Checkbox>Agree</Checkbox><Toggle />
      <RadioGroup inline defaultValue='s'><Radio value='s'>Small</Radio><Radio value='l'>Large</Radio></RadioGroup>
      <Rate defaultValue={2} size='xs' /><Tag closable>Vegan</Tag></div>
    <div style={row}><Input placeholder='Name' style={{width: 150}} /><InputNumber defaultValue={3} style={{width: 100}} />
      <SelectPicker data={[{label: 'Apple', value: 'a'}, {label: 'Grape', value: 'g'}]} searchable={false} style={{width: 150}} />
      <Slider defaultValue={30} style={{width: 200}} /></div>
    <Nav appearance='tabs' activeKey={tab} onSelect={setTab}><Nav.Item eventKey='a'>One</Nav.Item><Nav.Item eventKey='b'>Two</Nav.Item></Nav>
    <Breadcrumb><Breadcrumb.Item href='#home'>Home</Breadcrumb.Item><Breadcrumb.Item active>Here</Breadcrumb.Item></Breadcrumb>
    <div style={row}><Panel header='More' collapsible bordered style={{width: 200}}>Inside</Panel>
      <Tree defaultExpandAll data={[{label: 'Root', value: 'r', children: [{label: 'Leaf', value: 'l'}]}]} style={{width: 200, height: 100}} />
      <Pagination prev next total={50} limit={10} activePage={page} onChangePage={setPage} /></div>
    <Calendar compact bordered defaultValue={new Date(2026, 2, 10)} style={{width: 400}} />
    <Steps current={1}><Steps.Item title='One' /><Steps.Item title='Two' /></Steps>
  </div>
}
createRoot(document.getElementById('app')).render(<App />)

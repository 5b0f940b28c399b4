import React from 'react'
import {createRoot} from 'react-dom/client'
import {Button, Calendar, Checkbox, Collapse, Input, InputNumber, Menu, Radio, Rate, Segmented, Select, Slider, Space,
  Switch, Table, Tabs, Tag, Tree} from 'antd'
const rows = Array.from({length: 12}, (_, i) => ({key: i, name: 'Person ' + i, age: 20 + i}))
createRoot(document.getElementById('app')).render(<Space direction='vertical' style={{width: 900}}>
  <Menu mode='horizontal' items={[{key: 'a', label: 'Home'}, {key: 'b', label: 'About'}]} />
  <Space><Button type='primary'>Save</Button><Checkbox>Agree</Checkbox><Switch aria-label='Loud' />
    <Radio.Group options={['Small', 'Large']} /><Rate /><Tag closable>Label</Tag></Space>
  <Space><Input placeholder='Name' allowClear /><InputNumber defaultValue={3} />
    <Select style={{width: 120}} options={[{value: 'Apple'}, {value: 'Grape'}]} placeholder='Fruit' />
    <Segmented options={['Day', 'Week']} /></Space>
  <Slider style={{width: 300}} />
  <Tabs items={[{key: 1, label: 'One', children: 'First'}, {key: 2, label: 'Two', children: 'Second'}]} />
  <Collapse items={[{key: 1, label: 'More', children: 'Inside'}]} />
  <Tree checkable defaultExpandAll treeData={[{title: 'Root', key: 'r', children: [{title: 'Leaf', key: 'l'}]}]} />
  <Table size='small' rowSelection={{}} pagination={{pageSize: 3}} dataSource={rows}
    columns={[{title: 'Name', dataIndex: 'name'}, {title: 'Age', dataIndex: 'age', sorter: (a, b) => a.age - b.age}]} />
</Space>)

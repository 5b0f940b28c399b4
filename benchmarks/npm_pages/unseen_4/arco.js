import React from 'react'
import {createRoot} from 'react-dom/client'
import {Button, Calendar, Cascader, Checkbox, Collapse, Input, InputNumber, Link, Menu, Pagination, Radio, Rate, Select, Slider, Space, Switch, Table, Tabs, Tag, Transfer, Tree} from '@arco-design/web-react'
const rows = Array.from({length: 8}, (_, i) => ({key: i, name: 'Person ' + i, age: 20 + i, town: ['Bonn', 'Kiel'][i % 2]}))
createRoot(document.getElementById('app')).render(<Space direction='vertical' style={{width: 1100, padding: 8}}>
  <Menu mode='horizontal' defaultSelectedKeys={['1']}><Menu.Item key='1'>Home</Menu.Item><Menu.Item key='2'>About</Menu.Item><Menu.Item key='3' disabled>Closed</Menu.Item></Menu>
  <Space><Button type='primary'>Save</Button><Button disabled>Send</Button><Link href='#more'>More</Link><Checkbox>Agree</Checkbox><Switch /><Radio.Group options={['Small', 'Large']} /><Rate /><Tag closable>Label</Tag></Space>
  <Space><Input placeholder='Name' allowClear /><InputNumber defaultValue={3} mode='button' style={{width: 140}} /><Select style={{width: 140}} placeholder='Fruit' options={['Apple', 'Grape']} /><Cascader style={{width: 160}} placeholder='Town' options={[{value: 'de', label: 'Germany', children: [{value: 'b', label: 'Bonn'}]}]} /></Space>
  <Slider style={{width: 300}} />
  <div style={{display: 'flex', gap: 20}}>
    <div style={{width: 300}}><Tabs><Tabs.TabPane key='1' title='One'>First</Tabs.TabPane><Tabs.TabPane key='2' title='Two'>Second</Tabs.TabPane></Tabs>
      <Collapse defaultActiveKey={['1']}><Collapse.Item header='Size' name='1'>Large</Collapse.Item><Collapse.Item header='Price' name='2'>Low</Collapse.Item></Collapse>
      <Tree checkable treeData={[{title: 'Trunk', key: '0', children: [{title: 'Branch', key: '0-0'}, {title: 'Leaf', key: '0-1', disabled: true}]}]} /></div>
    <Calendar panel style={{width: 300}} defaultValue='2026-03-10' />
    <div style={{width: 450}}><Table size='small' rowSelection={{}} pagination={{pageSize: 4}} data={rows} columns={[{title: 'Name', dataIndex: 'name'}, {title: 'Age', dataIndex: 'age', sorter: (a, b) => a.age - b.age}, {title: 'Town', dataIndex: 'town', filters: [{text: 'Bonn', value: 'Bonn'}], onFilter: (value, row) => row.town === value}]} />
      <Pagination total={60} size='mini' showJumper /></div></div>
  <Transfer dataSource={rows.slice(0, 4).map((row) => ({key: String(row.key), value: row.name}))} defaultTargetKeys={['2']} />
</Space>)

import React from 'react'
import {createRoot} from 'react-dom/client'
import {Accordion, Button, Card, Checkbox, Dropdown, Form, Icon, Input, Label, List, Menu, Pagination, Radio, Rating, Step, Tab, Table} from 'semantic-ui-react'
const App = () => {
  const [active, setActive] = React.useState('Home')
  const [labels, setLabels] = React.useState(['Red', 'Blue'])
  const [row, setRow] = React.useState('')
  return <>
    <Menu pointing secondary>{['Home', 'Messages', 'Friends'].map((name) => <Menu.Item key={name} name={name} active={active === name} onClick={() => setActive(name)} />)}<Menu.Menu position='right'><Menu.Item><Input icon='search' placeholder='Search...' /></Menu.Item></Menu.Menu></Menu>
    <Button primary>Save</Button><Button disabled>Send</Button> <Checkbox label='Agree' /> <Checkbox toggle label='Notify' /> <Rating icon='star' defaultRating={3} maxRating={5} /> {labels.map((name) => <Label key={name} onRemove={() => setLabels(labels.filter((one) => one !== name))}>{name}</Label>)}
    <p><Dropdown placeholder='Fruit' selection clearable options={['Apple', 'Grape'].map((text) => ({key: text, value: text, text}))} /> <Dropdown placeholder='Skills' multiple search selection options={['Angular', 'CSS', 'HTML'].map((text) => ({key: text, value: text, text}))} /> <Dropdown text='File' button><Dropdown.Menu><Dropdown.Item text='New' /><Dropdown.Item text='Open' /></Dropdown.Menu></Dropdown></p>
    <Tab panes={[{menuItem: 'One', render: () => <Tab.Pane>First</Tab.Pane>}, {menuItem: 'Two', render: () => <Tab.Pane>Second</Tab.Pane>}]} />
    <Accordion panels={[{key: 1, title: 'What is it?', content: 'A library'}, {key: 2, title: 'Is it free?', content: 'Yes'}]} defaultActiveIndex={0} />
    <Table celled selectable compact style={{width: 500}}><Table.Header><Table.Row><Table.HeaderCell>Name</Table.HeaderCell><Table.HeaderCell>Age</Table.HeaderCell></Table.Row></Table.Header><Table.Body>{['Ada', 'Grace', 'Mary'].map((name, i) => <Table.Row key={name} active={row === name} onClick={() => setRow(name)}><Table.Cell>{name}</Table.Cell><Table.Cell>{30 + i}</Table.Cell></Table.Row>)}</Table.Body></Table>
    <Pagination defaultActivePage={2} totalPages={8} />
  </>
}
createRoot(document.getElementById('app')).render(<App />)

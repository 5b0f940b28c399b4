import React from 'react'
import {createRoot} from 'react-dom/client'
import {Accordion, AccordionHeader, AccordionItem, AccordionPanel, Avatar, Button, Checkbox, Combobox, Dialog, DialogActions, DialogBody, DialogContent, DialogSurface, DialogTitle, DialogTrigger, Dropdown, Field, FluentProvider, Input, InteractionTag, InteractionTagPrimary, InteractionTagSecondary, Link, Menu, MenuItem, MenuList, MenuPopover, MenuTrigger, Option, Radio, RadioGroup, Rating, SearchBox, Slider, SpinButton, SplitButton, Switch, Tab, TabList, Table, TableBody, TableCell, TableHeader, TableHeaderCell, TableRow, TableSelectionCell, Tag, TagGroup, ToggleButton, Toolbar, ToolbarButton, ToolbarToggleButton, Tree, TreeItem, TreeItemLayout, webLightTheme} from '@fluentui/react-components'

const people = ['Ada', 'Grace', 'Mary']

const App = () => {
  const [tab, setTab] = React.useState('inbox')
  const [tags, setTags] = React.useState(['Family', 'Work', 'Travel'])
  const [chosen, setChosen] = React.useState([])
  return <FluentProvider theme={webLightTheme} style={{padding: 16}}>
    <div style={{display: 'flex', gap: 24}}>
      <TabList selectedValue={tab} onTabSelect={(event, data) => setTab(data.value)}><Tab value='inbox'>Inbox</Tab><Tab value='drafts'>Drafts</Tab><Tab value='spam' disabled>Spam</Tab></TabList>
      <Toolbar aria-label='Text' checkedValues={undefined}><ToolbarButton>Undo</ToolbarButton><ToolbarToggleButton name='style' value='bold'>Bold</ToolbarToggleButton><ToolbarToggleButton name='style' value='italic'>Italic</ToolbarToggleButton></Toolbar>
      <Menu><MenuTrigger disableButtonEnhancement><Button>More</Button></MenuTrigger><MenuPopover><MenuList><MenuItem>Archive</MenuItem><MenuItem>Print</MenuItem></MenuList></MenuPopover></Menu>
      <Menu positioning='below-end'><MenuTrigger disableButtonEnhancement>{(props) => <SplitButton menuButton={props}>Reply</SplitButton>}</MenuTrigger><MenuPopover><MenuList><MenuItem>Reply to all</MenuItem></MenuList></MenuPopover></Menu>
      <Dialog><DialogTrigger disableButtonEnhancement><Button appearance='primary'>Write</Button></DialogTrigger><DialogSurface><DialogBody><DialogTitle>New mail</DialogTitle><DialogContent>Nothing yet.</DialogContent><DialogActions><DialogTrigger disableButtonEnhancement><Button>Close</Button></DialogTrigger></DialogActions></DialogBody></DialogSurface></Dialog>
    </div>
    <div style={{display: 'flex', gap: 32, marginTop: 16}}>
      <div style={{width: 300, display: 'grid', gap: 8}}>
        <Field label='Subject'><Input defaultValue='Holidays' /></Field>
        <Field label='To'><Dropdown placeholder='Choose a person' clearable>{people.map((name) => <Option key={name}>{name}</Option>)}</Dropdown></Field>
        <Field label='Copy to'><Combobox placeholder='Search a person' multiselect>{people.map((name) => <Option key={name}>{name}</Option>)}</Combobox></Field>
        <Field label='Copies'><SpinButton defaultValue={10} min={0} max={20} /></Field>
        <SearchBox placeholder='Search mail' />
        <Field label='Priority'><RadioGroup layout='horizontal' defaultValue='low'><Radio value='low' label='Low' /><Radio value='high' label='High' /></RadioGroup></Field>
        <Slider defaultValue={20} aria-label='Text size' />
        <Rating defaultValue={3} />
      </div>
      <div style={{width: 300}}>
        <Checkbox label='Ask for a receipt' /><Switch label='Encrypt' defaultChecked /><Switch label='Later' disabled /><ToggleButton>Mute</ToggleButton> <Link href='#help'>Help</Link>
        <TagGroup onDismiss={(event, {value}) => setTags(tags.filter((tag) => tag !== value))} aria-label='Labels'>{tags.map((tag) => <Tag key={tag} value={tag} dismissible dismissIcon={{'aria-label': 'remove'}}>{tag}</Tag>)}</TagGroup>
        <p><InteractionTag><InteractionTagPrimary hasSecondaryAction>Grace</InteractionTagPrimary><InteractionTagSecondary aria-label='remove' /></InteractionTag></p>
        <Accordion collapsible defaultOpenItems='1'><AccordionItem value='1'><AccordionHeader>Signature</AccordionHeader><AccordionPanel>With kind regards</AccordionPanel></AccordionItem><AccordionItem value='2'><AccordionHeader>Attachments</AccordionHeader><AccordionPanel>None</AccordionPanel></AccordionItem></Accordion>
      </div>
      <div style={{width: 480}}>
        <Tree aria-label='Folders' defaultOpenItems={['mail']}><TreeItem itemType='branch' value='mail'><TreeItemLayout>Mail</TreeItemLayout><Tree><TreeItem itemType='leaf'><TreeItemLayout>Bills</TreeItemLayout></TreeItem><TreeItem itemType='leaf'><TreeItemLayout>Letters</TreeItemLayout></TreeItem></Tree></TreeItem><TreeItem itemType='branch' value='old'><TreeItemLayout>Old mail</TreeItemLayout><Tree><TreeItem itemType='leaf'><TreeItemLayout>2025</TreeItemLayout></TreeItem></Tree></TreeItem></Tree>
        <Table size='small' aria-label='Mail'><TableHeader><TableRow><TableSelectionCell checked={chosen.length === people.length ? true : chosen.length ? 'mixed' : false} onClick={() => setChosen(chosen.length === people.length ? [] : people)} /><TableHeaderCell>From</TableHeaderCell><TableHeaderCell>Date</TableHeaderCell></TableRow></TableHeader>
          <TableBody>{people.map((name, i) => <TableRow key={name} aria-selected={chosen.includes(name)} onClick={() => setChosen(chosen.includes(name) ? chosen.filter((one) => one !== name) : [...chosen, name])}><TableSelectionCell checked={chosen.includes(name)} /><TableCell><Avatar name={name} size={24} /> {name}</TableCell><TableCell>{i + 3} March</TableCell></TableRow>)}</TableBody></Table>
      </div>
    </div>
  </FluentProvider>
}
createRoot(document.getElementById('app')).render(<App />)

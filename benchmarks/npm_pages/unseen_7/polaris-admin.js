import React from 'react'
import {createRoot} from 'react-dom/client'
import {ActionList, AppProvider, Autocomplete, Badge, BlockStack, Button, ButtonGroup, Card, Checkbox, ChoiceList, Collapsible, DatePicker, DropZone, Frame, IndexFilters, IndexTable, InlineStack, Layout, Navigation, Page, Pagination, Popover, RadioButton, RangeSlider, Select, Tag, Text, TextField, Toast, TopBar, useIndexResourceState, useSetIndexFiltersMode} from '@shopify/polaris'
import {HomeIcon, OrderIcon, ProductIcon} from '@shopify/polaris-icons'
import texts from '@shopify/polaris/locales/en.json'

const orders = [['1020', 'Jul 20', 'Jaydon Stanton', '$969.44', 'Paid'], ['1019', 'Jul 20', 'Ruben Westerfelt', '$701.19', 'Pending'], ['1018', 'Jul 19', 'Leo Carder', '$798.24', 'Paid']].map(([id, date, customer, total, status]) => ({id, date, customer, total, status}))
const towns = ['Antwerp', 'Bonn', 'Ghent', 'Turin'].map((label) => ({label, value: label}))

const Orders = () => {
  const {mode, setMode} = useSetIndexFiltersMode()
  const [tab, setTab] = React.useState(0)
  const [query, setQuery] = React.useState('')
  const [sort, setSort] = React.useState(['order asc'])
  const {selectedResources, allResourcesSelected, handleSelectionChange} = useIndexResourceState(orders)
  const tabs = ['All', 'Unpaid', 'Open'].map((content, index) => ({content, index, id: content, isLocked: index === 0, onAction: () => {}, actions: index ? [{type: 'rename'}, {type: 'delete'}] : []}))
  return <Card padding='0'>
    <IndexFilters tabs={tabs} selected={tab} onSelect={setTab} queryValue={query} queryPlaceholder='Search all orders' onQueryChange={setQuery} onQueryClear={() => setQuery('')} sortOptions={[{label: 'Order', value: 'order asc', directionLabel: 'Ascending'}, {label: 'Order', value: 'order desc', directionLabel: 'Descending'}]} sortSelected={sort} onSort={setSort} filters={[]} appliedFilters={[]} onClearAll={() => {}} mode={mode} setMode={setMode} canCreateNewView onCreateNewView={async () => true} />
    <IndexTable resourceName={{singular: 'order', plural: 'orders'}} itemCount={orders.length} selectedItemsCount={allResourcesSelected ? 'All' : selectedResources.length} onSelectionChange={handleSelectionChange} headings={['Order', 'Date', 'Customer', 'Total', 'Payment'].map((title) => ({title}))} sortable={[true, true, false, true, false]} onSort={() => {}}>
      {orders.map(({id, date, customer, total, status}, index) => <IndexTable.Row id={id} key={id} position={index} selected={selectedResources.includes(id)}><IndexTable.Cell><Text as='span' fontWeight='bold'>{id}</Text></IndexTable.Cell><IndexTable.Cell>{date}</IndexTable.Cell><IndexTable.Cell>{customer}</IndexTable.Cell><IndexTable.Cell>{total}</IndexTable.Cell><IndexTable.Cell><Badge>{status}</Badge></IndexTable.Cell></IndexTable.Row>)}
    </IndexTable>
  </Card>
}

const App = () => {
  const [title, setTitle] = React.useState('Canvas shoe')
  const [count, setCount] = React.useState('3')
  const [status, setStatus] = React.useState('active')
  const [choices, setChoices] = React.useState(['online'])
  const [radio, setRadio] = React.useState('physical')
  const [tracked, setTracked] = React.useState(true)
  const [range, setRange] = React.useState(32)
  const [tags, setTags] = React.useState(['Rustic', 'Vintage', 'Chic'])
  const [town, setTown] = React.useState('')
  const [popover, setPopover] = React.useState(false)
  const [open, setOpen] = React.useState(false)
  const [toast, setToast] = React.useState(false)
  const [menu, setMenu] = React.useState(false)
  const [pressed, setPressed] = React.useState(0)
  const [{month, year}, setDate] = React.useState({month: 2, year: 2026})
  const [days, setDays] = React.useState({start: new Date(2026, 2, 10), end: new Date(2026, 2, 12)})
  const bar = <TopBar showNavigationToggle userMenu={<TopBar.UserMenu name='Dharma' detail='Shoe shop' initials='D' open={menu} onToggle={() => setMenu(!menu)} actions={[{items: [{content: 'Account'}]}]} />} searchField={<TopBar.SearchField onChange={() => {}} value='' placeholder='Search' />} />
  const side = <Navigation location='/'><Navigation.Section items={[{url: '#home', label: 'Home', icon: HomeIcon}, {url: '#orders', label: 'Orders', icon: OrderIcon, badge: '15', selected: true, subNavigationItems: [{url: '#drafts', label: 'Drafts'}]}, {url: '#products', label: 'Products', icon: ProductIcon}]} /></Navigation>
  return <Frame topBar={bar} navigation={side}>
    <Page fullWidth title='Orders' backAction={{content: 'Home', url: '#home'}} primaryAction={{content: 'Create order', onAction: () => setToast(true)}} secondaryActions={[{content: 'Export', onAction: () => setToast(true)}, {content: 'Import', disabled: true}]} actionGroups={[{title: 'More actions', actions: [{content: 'Duplicate'}, {content: 'Archive'}]}]} pagination={{hasNext: true, hasPrevious: false, onNext: () => setToast(true)}}>
      <Layout><Layout.Section><BlockStack gap='300'><Orders />
        <Card><InlineStack gap='300' wrap={false}><DatePicker month={month} year={year} onChange={setDays} onMonthChange={(m, y) => setDate({month: m, year: y})} selected={days} allowRange /><div style={{width: 260}}><DropZone allowMultiple={false}><DropZone.FileUpload actionTitle='Add file' /></DropZone><Pagination hasPrevious hasNext onNext={() => setToast(true)} onPrevious={() => setToast(true)} label='2 of 8' /></div></InlineStack></Card>
      </BlockStack></Layout.Section>
      <Layout.Section variant='oneThird'><Card><BlockStack gap='200'>
        <TextField label='Title' value={title} onChange={setTitle} autoComplete='off' clearButton onClearButtonClick={() => setTitle('')} labelAction={{content: 'Reset', onAction: () => setTitle('')}} />
        <TextField label='Quantity' type='number' value={count} onChange={setCount} autoComplete='off' />
        <Select label='Status' options={[{label: 'Active', value: 'active'}, {label: 'Draft', value: 'draft'}]} value={status} onChange={setStatus} />
        <Autocomplete options={towns} selected={[]} onSelect={([one]) => setTown(one)} textField={<Autocomplete.TextField label='Town' value={town} onChange={setTown} autoComplete='off' placeholder='Search' />} />
        <InlineStack gap='200'><ChoiceList allowMultiple title='Sold' choices={[{label: 'Online', value: 'online'}, {label: 'In the shop', value: 'shop'}]} selected={choices} onChange={setChoices} /><div><RadioButton label='Physical' checked={radio === 'physical'} id='physical' onChange={() => setRadio('physical')} /><br /><RadioButton label='Digital' checked={radio === 'digital'} id='digital' onChange={() => setRadio('digital')} /></div></InlineStack>
        <Checkbox label='Track quantity' checked={tracked} onChange={setTracked} /><RangeSlider label='Opacity' value={range} onChange={setRange} output />
        <InlineStack gap='100'>{tags.map((tag) => <Tag key={tag} onRemove={() => setTags(tags.filter((one) => one !== tag))}>{tag}</Tag>)}</InlineStack>
        <ButtonGroup variant='segmented'>{['Day', 'Week', 'Month'].map((name, index) => <Button key={name} pressed={pressed === index} onClick={() => setPressed(index)}>{name}</Button>)}</ButtonGroup>
        <InlineStack gap='200'><Popover active={popover} onClose={() => setPopover(false)} activator={<Button disclosure onClick={() => setPopover(!popover)}>Sales channels</Button>}><ActionList items={[{content: 'Online shop'}, {content: 'Buy button'}]} /></Popover><Button onClick={() => setOpen(!open)} ariaExpanded={open} ariaControls='more' variant='plain'>Details</Button><Button disabled>Delete</Button></InlineStack>
        <Collapsible open={open} id='more'>More about it</Collapsible>
      </BlockStack></Card></Layout.Section></Layout>
    </Page>{toast && <Toast content='Order created' onDismiss={() => setToast(false)} />}
  </Frame>
}
createRoot(document.getElementById('app')).render(<AppProvider i18n={texts}><App /></AppProvider>)

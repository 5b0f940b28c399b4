import React from 'react'
import {createRoot} from 'react-dom/client'
import AppLayout from '@cloudscape-design/components/app-layout'
import Box from '@cloudscape-design/components/box'
import Button from '@cloudscape-design/components/button'
import ButtonDropdown from '@cloudscape-design/components/button-dropdown'
import ExpandableSection from '@cloudscape-design/components/expandable-section'
import Header from '@cloudscape-design/components/header'
import Multiselect from '@cloudscape-design/components/multiselect'
import Pagination from '@cloudscape-design/components/pagination'
import SegmentedControl from '@cloudscape-design/components/segmented-control'
import Select from '@cloudscape-design/components/select'
import SideNavigation from '@cloudscape-design/components/side-navigation'
import SpaceBetween from '@cloudscape-design/components/space-between'
import Table from '@cloudscape-design/components/table'
import Tabs from '@cloudscape-design/components/tabs'
import TextFilter from '@cloudscape-design/components/text-filter'
import Toggle from '@cloudscape-design/components/toggle'
import TokenGroup from '@cloudscape-design/components/token-group'

const servers = Array.from({length: 5}, (_, i) => ({name: `server-${i + 1}`, zone: ['north', 'south'][i % 2], size: ['small', 'large', 'medium'][i % 3]}))
const options = ['north', 'south', 'west'].map((value) => ({label: value, value}))

const App = () => {
  const [active, setActive] = React.useState('#/servers')
  const [selectedItems, setSelectedItems] = React.useState([servers[1]])
  const [text, setText] = React.useState('')
  const [page, setPage] = React.useState(1)
  const [sort, setSort] = React.useState({sortingColumn: {sortingField: 'name'}})
  const [zone, setZone] = React.useState(options[0])
  const [zones, setZones] = React.useState(options.slice(1, 2))
  const [view, setView] = React.useState('list')
  const [on, setOn] = React.useState(true)
  const [tokens, setTokens] = React.useState([{label: 'web'}, {label: 'test'}])
  const rows = servers.filter((server) => server.name.includes(text)).sort((a, b) => (a[sort.sortingColumn.sortingField] < b[sort.sortingColumn.sortingField] ? -1 : 1) * (sort.isDescending ? -1 : 1))
  return <AppLayout toolsHide
    navigation={<SideNavigation activeHref={active} header={{href: '#/', text: 'Machines'}} onFollow={(event) => { event.preventDefault(); setActive(event.detail.href) }} items={[{type: 'link', text: 'Servers', href: '#/servers'}, {type: 'link', text: 'Disks', href: '#/disks'}, {type: 'section', text: 'Network', items: [{type: 'link', text: 'Rules', href: '#/rules'}]}, {type: 'divider'}, {type: 'link', text: 'Help', href: '#/help'}]} />}
    content={<SpaceBetween size='m'>
      <Table variant='container' items={rows} trackBy='name' selectionType='multi' selectedItems={selectedItems} onSelectionChange={({detail}) => setSelectedItems(detail.selectedItems)} sortingColumn={sort.sortingColumn} sortingDescending={sort.isDescending} onSortingChange={({detail}) => setSort(detail)} ariaLabels={{selectionGroupLabel: 'Servers', allItemsSelectionLabel: () => 'select all', itemSelectionLabel: (_, item) => item.name}}
        columnDefinitions={[{id: 'name', header: 'Name', cell: (item) => <a href={`#${item.name}`}>{item.name}</a>, sortingField: 'name'}, {id: 'zone', header: 'Zone', cell: (item) => item.zone, sortingField: 'zone'}, {id: 'size', header: 'Size', cell: (item) => item.size}]}
        header={<Header counter={`(${rows.length})`} actions={<SpaceBetween direction='horizontal' size='xs'><ButtonDropdown items={[{text: 'Stop', id: 'stop'}, {text: 'Start', id: 'start', disabled: true}]}>Actions</ButtonDropdown><Button disabled>Edit</Button><Button variant='primary'>Create server</Button></SpaceBetween>}>Servers</Header>}
        filter={<TextFilter filteringText={text} filteringPlaceholder='Find servers' onChange={({detail}) => setText(detail.filteringText)} />}
        pagination={<Pagination currentPageIndex={page} pagesCount={4} onChange={({detail}) => setPage(detail.currentPageIndex)} />} />
      <SpaceBetween direction='horizontal' size='m'><div style={{width: 200}}><Select selectedOption={zone} options={options} onChange={({detail}) => setZone(detail.selectedOption)} /></div><div style={{width: 220}}><Multiselect selectedOptions={zones} options={options} placeholder='Choose zones' onChange={({detail}) => setZones(detail.selectedOptions)} /></div><SegmentedControl selectedId={view} onChange={({detail}) => setView(detail.selectedId)} options={[{text: 'List', id: 'list'}, {text: 'Map', id: 'map'}, {text: 'Cost', id: 'cost'}]} /><Toggle checked={on} onChange={({detail}) => setOn(detail.checked)}>Alarms</Toggle><TokenGroup items={tokens} onDismiss={({detail}) => setTokens(tokens.filter((_, i) => i !== detail.itemIndex))} /></SpaceBetween>
      <Tabs tabs={[{label: 'Details', id: 'a', content: <ExpandableSection headerText='Rules'>Port 443 is open.</ExpandableSection>}, {label: 'Disks', id: 'b', content: <Box>Two disks</Box>}, {label: 'Costs', id: 'c', content: <Box>None</Box>, disabled: true}]} />
    </SpaceBetween>} />
}
createRoot(document.getElementById('app')).render(<App />)

import React from 'react'
import {createRoot} from 'react-dom/client'
import {createColumnHelper, flexRender, getCoreRowModel, getExpandedRowModel, getFilteredRowModel, getPaginationRowModel, getSortedRowModel, useReactTable} from '@tanstack/react-table'
import {DragDropContext, Draggable, Droppable} from '@hello-pangea/dnd'

const data = Array.from({length: 30}, (_, i) => ({name: `Task ${i + 1}`, owner: ['Ada', 'Grace', 'Mary'][i % 3], hours: (i * 7) % 12 + 1}))
const helper = createColumnHelper()
const columns = [
  helper.display({id: 'select', header: ({table}) => <input type='checkbox' aria-label='All' checked={table.getIsAllPageRowsSelected()} onChange={table.getToggleAllPageRowsSelectedHandler()} />, cell: ({row}) => <input type='checkbox' aria-label={`Row ${row.id}`} checked={row.getIsSelected()} onChange={row.getToggleSelectedHandler()} />}),
  helper.accessor('name', {header: 'Name', cell: ({row, getValue}) => <><button onClick={row.getToggleExpandedHandler()} style={{cursor: 'pointer'}}>{row.getIsExpanded() ? '▼' : '▶'}</button> {getValue()}</>}),
  helper.accessor('owner', {header: 'Owner'}),
  helper.accessor('hours', {header: 'Hours'}),
]

const Grid = () => {
  const [sorting, setSorting] = React.useState([])
  const [rowSelection, setRowSelection] = React.useState({})
  const [globalFilter, setGlobalFilter] = React.useState('')
  const [expanded, setExpanded] = React.useState({})
  const table = useReactTable({data, columns, state: {sorting, rowSelection, globalFilter, expanded}, onSortingChange: setSorting, onRowSelectionChange: setRowSelection, onGlobalFilterChange: setGlobalFilter, onExpandedChange: setExpanded, getRowCanExpand: () => true, getCoreRowModel: getCoreRowModel(), getSortedRowModel: getSortedRowModel(), getFilteredRowModel: getFilteredRowModel(), getPaginationRowModel: getPaginationRowModel(), getExpandedRowModel: getExpandedRowModel(), initialState: {pagination: {pageSize: 8}}})
  return <div>
    <input value={globalFilter} onChange={(event) => setGlobalFilter(event.target.value)} placeholder='Search all columns...' />
    <table>
      <thead>{table.getHeaderGroups().map((group) => <tr key={group.id}>{group.headers.map((header) => <th key={header.id}><div className={header.column.getCanSort() ? 'cursor-pointer' : ''} onClick={header.column.getToggleSortingHandler()}>{flexRender(header.column.columnDef.header, header.getContext())}{{asc: ' 🔼', desc: ' 🔽'}[header.column.getIsSorted()] ?? null}</div></th>)}</tr>)}</thead>
      <tbody>{table.getRowModel().rows.map((row) => <React.Fragment key={row.id}><tr>{row.getVisibleCells().map((cell) => <td key={cell.id}>{flexRender(cell.column.columnDef.cell, cell.getContext())}</td>)}</tr>{row.getIsExpanded() && <tr><td colSpan={4}>{row.original.owner} works on it.</td></tr>}</React.Fragment>)}</tbody>
    </table>
    <p><button onClick={() => table.firstPage()} disabled={!table.getCanPreviousPage()}>{'<<'}</button> <button onClick={() => table.previousPage()} disabled={!table.getCanPreviousPage()}>{'<'}</button> <button onClick={() => table.nextPage()} disabled={!table.getCanNextPage()}>{'>'}</button> <button onClick={() => table.lastPage()} disabled={!table.getCanNextPage()}>{'>>'}</button> Page {table.getState().pagination.pageIndex + 1} of {table.getPageCount()} <select aria-label='Page size' value={table.getState().pagination.pageSize} onChange={(event) => table.setPageSize(Number(event.target.value))}>{[8, 16].map((size) => <option key={size} value={size}>Show {size}</option>)}</select></p>
  </div>
}

const Board = () => {
  const [lists, setLists] = React.useState({todo: ['Buy paint', 'Call the landlord', 'Measure the wall'], doing: ['Choose a colour'], done: ['Move the desk', 'Cover the floor']})
  const [open, setOpen] = React.useState('')
  const moved = ({source, destination}) => {
    if (!destination) return
    const next = Object.fromEntries(Object.entries(lists).map(([key, items]) => [key, [...items]]))
    const [item] = next[source.droppableId].splice(source.index, 1)
    next[destination.droppableId].splice(destination.index, 0, item)
    setLists(next)
  }
  return <DragDropContext onDragEnd={moved}><div style={{display: 'flex', gap: 12}}>{Object.entries(lists).map(([key, items]) => <Droppable key={key} droppableId={key}>{(area) => <div ref={area.innerRef} {...area.droppableProps} style={{background: '#ebecf0', padding: 8, width: 190, borderRadius: 6}}><h4 style={{margin: 4}}>{key}</h4>
    {items.map((item, index) => <Draggable key={item} draggableId={item} index={index}>{(card) => <div ref={card.innerRef} {...card.draggableProps} {...card.dragHandleProps} onClick={() => setOpen(item)} style={{background: '#fff', padding: 10, margin: '0 0 8px', borderRadius: 4, ...card.draggableProps.style}}>{item}</div>}</Draggable>)}
    {area.placeholder}<button onClick={() => setLists({...lists, [key]: [...items, `Card ${Date.now() % 1000}`]})}>+ Add a card</button></div>}</Droppable>)}</div><p>{open && `Opened: ${open}`}</p></DragDropContext>
}

createRoot(document.getElementById('app')).render(<div style={{display: 'flex', gap: 40}}><Grid /><Board /></div>)

import React from 'react'
import {createRoot} from 'react-dom/client'
import {Background, Controls, MiniMap, ReactFlow, addEdge, useEdgesState, useNodesState} from '@xyflow/react'
const nodes0 = [{id: '1', position: {x: 250, y: 20}, data: {label: 'Start'}, type: 'input'}, {id: '2', position: {x: 100, y: 150}, data: {label: 'Left'}}, {id: '3', position: {x: 400, y: 150}, data: {label: 'Right'}}, {id: '4', position: {x: 250, y: 300}, data: {label: 'End'}, type: 'output'}]
const edges0 = [{id: 'e1', source: '1', target: '2'}, {id: 'e2', source: '1', target: '3', animated: true, label: 'yes'}, {id: 'e3', source: '2', target: '4'}]
const App = () => {
  const [nodes, , onNodesChange] = useNodesState(nodes0)
  const [edges, setEdges, onEdgesChange] = useEdgesState(edges0)
  return <ReactFlow nodes={nodes} edges={edges} onNodesChange={onNodesChange} onEdgesChange={onEdgesChange} onConnect={(p) => setEdges((all) => addEdge(p, all))}><Controls /><MiniMap /><Background /></ReactFlow>
}
createRoot(document.getElementById('app')).render(<App />)

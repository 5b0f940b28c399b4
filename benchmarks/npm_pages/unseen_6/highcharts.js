import React from 'react'
import {createRoot} from 'react-dom/client'
import {Bar, BarChart, Brush, CartesianGrid, Cell, Legend, Line, LineChart, Tooltip, XAxis, YAxis} from 'recharts'

const days = ['Mon', 'Tue', 'Wed', 'Thu', 'Fri', 'Sat', 'Sun'].map((name, i) => ({name, sold: 20 + (i * 13) % 30, given: 10 + (i * 7) % 20}))

const App = () => {
  const [active, setActive] = React.useState(2)
  return <div style={{display: 'flex', gap: 20}}>
    <div><BarChart width={560} height={260} data={days}><XAxis dataKey='name' /><YAxis /><Bar dataKey='sold' onClick={(data, index) => setActive(index)}>{days.map((day, index) => <Cell key={day.name} cursor='pointer' fill={index === active ? '#82ca9d' : '#8884d8'} />)}</Bar></BarChart><p>{days[active].name}: {days[active].sold} tickets</p></div>
    <LineChart width={560} height={280} data={days}><CartesianGrid strokeDasharray='3 3' /><XAxis dataKey='name' /><YAxis /><Tooltip /><Legend /><Line dataKey='sold' stroke='#8884d8' /><Line dataKey='given' stroke='#82ca9d' /><Brush dataKey='name' height={24} /></LineChart>
  </div>
}
createRoot(document.getElementById('app')).render(<App />)

import React from 'react'
import {createRoot} from 'react-dom/client'
import {DateRangePicker} from 'react-date-range'
import Calendar from 'react-calendar'
import uPlot from 'uplot'
import {PieChart} from 'chartist'
import {VictoryBar, VictoryChart, VictoryLegend} from 'victory'

const App = () => {
  const [range, setRange] = React.useState({startDate: new Date(2026, 2, 10), endDate: new Date(2026, 2, 14), key: 'selection'})
  const [day, setDay] = React.useState(new Date(2026, 2, 10))
  const [guests, setGuests] = React.useState(2)
  const [picked, pick] = React.useState('')
  const plot = React.useRef()
  const pie = React.useRef()
  React.useEffect(() => {
    const plotted = new uPlot({title: 'Nights sold', width: 380, height: 210, series: [{}, {label: 'Rooms', stroke: 'teal'}, {label: 'Flats', stroke: 'brown'}], scales: {x: {time: false}}}, [[1, 2, 3, 4, 5, 6], [3, 7, 4, 8, 9, 6], [5, 4, 6, 2, 3, 4]], plot.current)
    new PieChart(pie.current, {series: [20, 30, 50], labels: ['Sea', 'Town', 'Hills']}, {width: 180, height: 180})
    return () => plotted.destroy()
  }, [])
  return <>
    <header className='row' style={{background: '#234', color: 'white'}}><b>Rooms</b><a href='#stays' style={{color: 'white'}}>Stays</a><a href='#trips' style={{color: 'white'}}>Trips</a><span style={{flex: 1}} /><button onClick={() => setGuests(guests - 1)} disabled={guests < 2} aria-label='Fewer guests'>−</button>{guests} guests<button onClick={() => setGuests(guests + 1)} aria-label='More guests'>+</button></header>
    <div className='row'>
      <DateRangePicker ranges={[range]} onChange={({selection}) => setRange(selection)} months={1} direction='horizontal' moveRangeOnFirstSelection={false} />
      <Calendar value={day} onChange={setDay} showWeekNumbers minDate={new Date(2026, 1, 5)} />
      <p>{day.toDateString()}<br />{picked}</p>
    </div>
    <div className='row'>
      <div ref={plot} /><div ref={pie} style={{width: 180, height: 180}} />
      <div style={{width: 460}}><VictoryChart height={210} width={460} domainPadding={20}><VictoryLegend x={300} y={0} orientation='horizontal' data={[{name: 'Rooms'}, {name: 'Flats'}]} /><VictoryBar data={[{x: 'Jan', y: 13}, {x: 'Feb', y: 16}, {x: 'Mar', y: 14}, {x: 'Apr', y: 19}]} events={[{target: 'data', eventHandlers: {onClick: (_, {datum}) => { pick(`${datum.x}: ${datum.y}`); return [] }}}]} /></VictoryChart></div>
    </div>
  </>
}
createRoot(document.getElementById('app')).render(<App />)

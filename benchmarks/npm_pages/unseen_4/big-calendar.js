import React from 'react'
import {createRoot} from 'react-dom/client'
import moment from 'moment'
import {Calendar, momentLocalizer} from 'react-big-calendar'
const localizer = momentLocalizer(moment)
const App = () => {
  const [events, setEvents] = React.useState([{id: 1, title: 'Plan', start: new Date(2026, 2, 4, 10), end: new Date(2026, 2, 4, 12)}, {id: 2, title: 'Fair', start: new Date(2026, 2, 10), end: new Date(2026, 2, 13), allDay: true}])
  const [said, say] = React.useState('')
  return <><Calendar localizer={localizer} events={events} defaultDate={new Date(2026, 2, 10)} style={{height: 600}} selectable popup
    onSelectEvent={(event) => say(event.title)} onSelectSlot={({start, end}) => setEvents([...events, {id: events.length + 1, title: 'New', start, end}])} /><p>{said}</p></>
}
createRoot(document.getElementById('app')).render(<App />)

import {createCalendar, createViewDay, createViewMonthGrid, createViewWeek} from '@schedule-x/calendar'
createCalendar({
  selectedDate: '2026-03-11',
  defaultView: 'month-grid',
  views: [createViewDay(), createViewWeek(), createViewMonthGrid()],
  events: [{id: 1, title: 'Coffee with John', start: '2026-03-04 10:05', end: '2026-03-04 10:35'}, {id: 2, title: 'Skiing', start: '2026-03-12', end: '2026-03-14'}],
  callbacks: {onEventClick: (event) => { document.getElementById('said').textContent = event.title }, onClickDate: (date) => { document.getElementById('said').textContent = String(date) }},
}).render(document.getElementById('calendar'))

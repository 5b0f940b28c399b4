import '@vaadin/button'
import '@vaadin/checkbox'
import '@vaadin/text-field'
import '@vaadin/combo-box'
import '@vaadin/date-picker'
import '@vaadin/select'
import '@vaadin/tabs'
import '@vaadin/radio-group'
import '@vaadin/details'
import '@vaadin/grid'
import '@vaadin/grid/vaadin-grid-sort-column.js'
import '@vaadin/grid/vaadin-grid-selection-column.js'
const find = (name) => document.querySelector('vaadin-' + name)
find('combo-box').items = ['Bonn', 'Kiel', 'Ulm']
find('select').items = ['S', 'L'].map((value) => ({label: value, value}))
find('grid').items = Array.from({length: 20}, (_, i) => ({name: 'Person ' + i, age: 20 + i}))

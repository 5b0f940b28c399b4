import '@vaadin/menu-bar'
import '@vaadin/accordion'
import '@vaadin/multi-select-combo-box'
import '@vaadin/time-picker'
import '@vaadin/integer-field'
const bar = document.querySelector('vaadin-menu-bar')
bar.items = [{text: 'View'}, {text: 'Edit'}, {text: 'Share', children: [{text: 'By mail'}, {text: 'By link'}]}, {text: 'Move', disabled: true}]
bar.addEventListener('item-selected', (event) => { document.getElementById('said').textContent += event.detail.value.text + ' ' })
const box = document.querySelector('vaadin-multi-select-combo-box')
box.items = ['Apple', 'Banana', 'Grape', 'Pear']
box.selectedItems = ['Apple', 'Grape']

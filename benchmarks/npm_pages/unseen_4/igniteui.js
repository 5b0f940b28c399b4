import {defineAllComponents} from 'igniteui-webcomponents'
defineAllComponents()
const days = document.getElementById('days')
days.activeDate = new Date(2026, 2, 10)
days.value = new Date(2026, 2, 10)

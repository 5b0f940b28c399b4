import 'vanilla-colorful'
import 'vanilla-colorful/hex-input.js'
import {DuetDatePicker} from '@duetds/date-picker/custom-element'
customElements.get('duet-date-picker') || customElements.define('duet-date-picker', DuetDatePicker)
document.querySelector('hex-color-picker').addEventListener('color-changed', (event) => { document.getElementById('said').textContent = event.detail.value })

import 'ninja-keys'
import data from '@emoji-mart/data'
import {Picker} from 'emoji-mart'

const said = document.getElementById('said')
const text = document.getElementById('text')
document.getElementById('picker').appendChild(new Picker({data, onEmojiSelect: (emoji) => { text.value += emoji.native; said.textContent = emoji.id }}))
const ninja = document.querySelector('ninja-keys')
ninja.data = [
  {id: 'Projects', title: 'Open projects', hotkey: 'ctrl+N', section: 'Projects', handler: () => { said.textContent = 'projects' }},
  {id: 'Theme', title: 'Change theme...', children: ['Light theme', 'Dark theme']},
  {id: 'Light theme', title: 'Change theme to light', parent: 'Theme', handler: () => { said.textContent = 'light' }},
  {id: 'Dark theme', title: 'Change theme to dark', parent: 'Theme', handler: () => { said.textContent = 'dark' }},
]
document.getElementById('command').onclick = () => ninja.open()
document.getElementById('send').onclick = () => { said.textContent = `Sent: ${text.value}`; text.value = '' }

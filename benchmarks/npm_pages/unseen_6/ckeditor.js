import {Editor} from '@tiptap/core'
import StarterKit from '@tiptap/starter-kit'

const buttons = {
  Bold: ['bold', (chain) => chain.toggleBold()],
  Italic: ['italic', (chain) => chain.toggleItalic()],
  Strike: ['strike', (chain) => chain.toggleStrike()],
  Code: ['code', (chain) => chain.toggleCode()],
  Heading: ['heading', (chain) => chain.toggleHeading({level: 2})],
  List: ['bulletList', (chain) => chain.toggleBulletList()],
  Rule: ['', (chain) => chain.setHorizontalRule()],
}
const bar = document.getElementById('bubble')
const editor = new Editor({element: document.getElementById('tiptap'), extensions: [StarterKit], content: '<h2>Bread</h2><p>Knead the <em>dough</em> for ten minutes.</p>'})
for (const [label, [name, act]] of Object.entries(buttons)) {
  const button = document.createElement('button')
  button.textContent = label
  button.onclick = () => act(editor.chain().focus()).run()
  bar.append(button, ' ')
  editor.on('transaction', () => button.classList.toggle('is-active', name !== '' && editor.isActive(name)))
}

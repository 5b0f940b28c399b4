import React from 'react'
import {createRoot} from 'react-dom/client'
import {FileManager} from '@cubone/react-file-manager'
import '@cubone/react-file-manager/dist/style.css'

const App = () => {
  const [files, setFiles] = React.useState([
    {name: 'Music', isDirectory: true, path: '/Music', updatedAt: '2025-11-01T10:30:00Z'},
    {name: 'Rain.mp3', isDirectory: false, path: '/Music/Rain.mp3', updatedAt: '2025-11-02T10:30:00Z', size: 510885},
    {name: 'Letters', isDirectory: true, path: '/Letters', updatedAt: '2025-11-03T09:05:00Z'},
    {name: 'Landlord.txt', isDirectory: false, path: '/Letters/Landlord.txt', updatedAt: '2025-11-03T09:05:00Z', size: 900},
    {name: 'Old', isDirectory: true, path: '/Letters/Old', updatedAt: '2025-10-03T09:05:00Z'},
    {name: 'Info.txt', isDirectory: false, path: '/Info.txt', updatedAt: '2025-10-30T06:13:00Z', size: 1000},
    {name: 'Plan.pdf', isDirectory: false, path: '/Plan.pdf', updatedAt: '2025-10-29T06:13:00Z', size: 96000},
  ])
  return <FileManager files={files} onCreateFolder={(name, parent) => setFiles([...files, {name, isDirectory: true, path: `${parent?.path ?? ''}/${name}`, updatedAt: '2025-11-04T10:00:00Z'}])} onDelete={(gone) => setFiles(files.filter((file) => !gone.some((one) => file.path.startsWith(one.path))))} />
}
createRoot(document.getElementById('app')).render(<App />)

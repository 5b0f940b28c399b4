import React from 'react'
import {createRoot} from 'react-dom/client'
import {FixedSizeList} from 'react-window'
const App = () => {
  const [chosen, choose] = React.useState(-1)
  const Row = ({index, style}) => <div style={{...style, background: index === chosen ? '#cde' : '#fff'}} onClick={() => choose(index)}>Item {index}</div>
  return <FixedSizeList height={300} itemCount={1000} itemSize={32} width={300}>{Row}</FixedSizeList>
}
createRoot(document.getElementById('app')).render(<App />)

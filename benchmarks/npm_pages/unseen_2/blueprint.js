import React from 'react'
import {createRoot} from 'react-dom/client'
import {Button, Card, Checkbox, HTMLSelect, InputGroup, Menu, MenuItem, Navbar, NumericInput, Radio, RadioGroup, Section, SectionCard,
  SegmentedControl, Slider, Switch, Tab, Tabs, Tag, TagInput, Tree} from '@blueprintjs/core'
const App = () => {
  const [all, setAll] = React.useState({volume: 3, size: 's', view: 'day', tags: ['Bonn', 'Kiel'], open: true, card: false})
  const set = (more) => setAll({...all, ...more})
  const row = {display: 'flex', gap: 8, alignItems: 'center', margin: 8}
  return <div style={{width: 900}}>
    <Navbar><Navbar.Group><Navbar.Heading>News</Navbar.Heading><Button minimal icon='home' text='Home' /><Button minimal text='Files' /></Navbar.Group></Navbar>
    <div style={row}><Button intent='primary' text='Save' /><Checkbox label='Agree' inline /><Switch label='Loud' inline />
      <RadioGroup inline selectedValue={all.size} onChange={(e) => set({size: e.currentTarget.value})}><Radio value='s' label='Small' /><Radio value='l' label='Large' /></RadioGroup>
      <Tag interactive onClick={() => set({card: !all.card})}>Vegan</Tag></div>
    <div style={row}><InputGroup placeholder='Name' /><NumericInput defaultValue={3} /><HTMLSelect options={['Apple', 'Grape']} />
      <TagInput values={all.tags} onChange={(tags) => set({tags})} /></div>
    <div style={{...row, width: 300}}><Slider min={0} max={10} labelStepSize={5} value={all.volume} onChange={(volume) => set({volume})} /></div>
    <SegmentedControl options={[{label: 'Day', value: 'day'}, {label: 'Week', value: 'week'}]} value={all.view} onValueChange={(view) => set({view})} />
    <Tabs id='tabs'><Tab id='a' title='One' panel={<p>First</p>} /><Tab id='b' title='Two' panel={<p>Second</p>} /></Tabs>
    <div style={row}><Menu><MenuItem text='Open' onClick={() => set({card: !all.card})} /><MenuItem text='Share' disabled /><MenuItem text='More'><MenuItem text='Deep' /></MenuItem></Menu>
      <Tree contents={[{id: 1, label: 'Root', hasCaret: true, isExpanded: all.open, childNodes: [{id: 2, label: 'Leaf', isSelected: all.card}]}]}
        onNodeExpand={() => set({open: true})} onNodeCollapse={() => set({open: false})} onNodeClick={({id}) => id === 2 && set({card: !all.card})} />
      <Card interactive selected={all.card} onClick={() => set({card: !all.card})}>A card</Card></div>
    <Section title='Details' collapsible><SectionCard>Inside</SectionCard></Section>
  </div>
}
createRoot(document.getElementById('app')).render(<App />)

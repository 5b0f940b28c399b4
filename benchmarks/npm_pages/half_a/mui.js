import React, {useState} from 'react'
import {createRoot} from 'react-dom/client'
import {Accordion, AccordionDetails, AccordionSummary, AppBar, Autocomplete, BottomNavigation, BottomNavigationAction,
  Button, Card, CardActionArea, CardContent, Checkbox, Chip, FormControlLabel, IconButton, List, ListItemButton,
  ListItemText, MenuItem, Pagination, Radio, RadioGroup, Rating, Slider, Stack, Switch, Tab, Tabs, TextField,
  ToggleButton, ToggleButtonGroup, Toolbar, Typography} from '@mui/material'
const App = () => {
  const [tab, setTab] = useState(0)
  const [view, setView] = useState('day')
  const [picked, setPicked] = useState(false)
  return <Stack spacing={1} sx={{width: 800}}>
    <AppBar position='static'><Toolbar variant='dense'><IconButton color='inherit' aria-label='Menu'>≡</IconButton>
      <Typography sx={{flexGrow: 1}}>News</Typography><Button color='inherit'>Login</Button></Toolbar></AppBar>
    <Stack direction='row' spacing={1}><Button variant='contained'>Save</Button>
      <FormControlLabel control={<Checkbox />} label='Agree' /><FormControlLabel control={<Switch />} label='Loud' />
      <RadioGroup row><FormControlLabel value='s' control={<Radio />} label='Small' />
        <FormControlLabel value='l' control={<Radio />} label='Large' /></RadioGroup></Stack>
    <Stack direction='row' spacing={1}><TextField label='Name' size='small' />
      <TextField select label='Fruit' size='small' defaultValue='a'><MenuItem value='a'>Apple</MenuItem></TextField>
      <Autocomplete options={['Bonn', 'Kiel']} size='small' sx={{width: 200}}
        renderInput={(more) => <TextField {...more} label='Town' />} /></Stack>
    <Slider defaultValue={30} aria-label='Volume' sx={{width: 300}} />
    <Tabs value={tab} onChange={(_, to) => setTab(to)}><Tab label='One' /><Tab label='Two' /></Tabs>
    <Stack direction='row' spacing={1}>
      <Chip label='Vegan' onClick={() => setPicked(!picked)} color={picked ? 'primary' : 'default'} />
      <Chip label='Tag' onDelete={() => setPicked(!picked)} /><Rating />
      <ToggleButtonGroup exclusive size='small' value={view} onChange={(_, to) => setView(to)}>
        <ToggleButton value='day'>Day</ToggleButton><ToggleButton value='week'>Week</ToggleButton></ToggleButtonGroup>
      <Pagination count={3} /></Stack>
    <Accordion><AccordionSummary>More</AccordionSummary><AccordionDetails>Inside</AccordionDetails></Accordion>
    <List dense><ListItemButton selected={picked} onClick={() => setPicked(!picked)}><ListItemText primary='Inbox' />
      </ListItemButton><ListItemButton><ListItemText primary='Drafts' secondary='Some' /></ListItemButton></List>
    <Card><CardActionArea onClick={() => setPicked(!picked)}><CardContent>A card</CardContent></CardActionArea></Card>
    <BottomNavigation showLabels value={tab} onChange={(_, to) => setTab(to)}>
      <BottomNavigationAction label='Recent' /><BottomNavigationAction label='Near' /></BottomNavigation>
  </Stack>
}
createRoot(document.getElementById('app')).render(<App />)

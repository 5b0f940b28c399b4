import React from 'react'
import {createRoot} from 'react-dom/client'
import {Accordion, Alert, Badge, Button, ButtonGroup, Card, Carousel, Col, Container, Dropdown, DropdownButton, Form, InputGroup, ListGroup, Modal, Nav, Navbar, NavDropdown, Offcanvas, OverlayTrigger, Popover, Row, SplitButton, Tab, Tabs, ToggleButton} from 'react-bootstrap'
import ReactPaginate from 'react-paginate'

const places = Array.from({length: 24}, (_, i) => `Room ${i + 1}`)

const App = () => {
  const [page, setPage] = React.useState(0)
  const [shown, setShown] = React.useState(true)
  const [open, setOpen] = React.useState(false)
  const [side, setSide] = React.useState(false)
  const [view, setView] = React.useState('1')
  const [validated, setValidated] = React.useState(false)
  return <>
    <Navbar expand className='bg-body-tertiary'><Container fluid><Navbar.Brand href='#home'>Guest House</Navbar.Brand><Navbar.Toggle aria-controls='nav' /><Navbar.Collapse id='nav'><Nav className='me-auto'><Nav.Link href='#rooms'>Rooms</Nav.Link><Nav.Link href='#food'>Food</Nav.Link><NavDropdown title='More' id='more'><NavDropdown.Item href='#way'>How to find us</NavDropdown.Item><NavDropdown.Divider /><NavDropdown.Item href='#jobs'>Jobs</NavDropdown.Item></NavDropdown></Nav><Button variant='outline-secondary' onClick={() => setSide(true)}>Filters</Button></Navbar.Collapse></Container></Navbar>
    <Container fluid className='mt-3'>
      {shown && <Alert variant='info' onClose={() => setShown(false)} dismissible>We are closed in November. <Alert.Link href='#closed'>Why?</Alert.Link></Alert>}
      <Row>
        <Col xs={4}>
          <Form noValidate validated={validated} onSubmit={(event) => { event.preventDefault(); setValidated(true) }}>
            <Form.Group className='mb-2' controlId='mail'><Form.Label>E-mail address</Form.Label><Form.Control type='email' placeholder='Enter e-mail' required /></Form.Group>
            <InputGroup className='mb-2'><InputGroup.Text>Nights</InputGroup.Text><Form.Control type='number' defaultValue={2} aria-label='Nights' /><DropdownButton variant='outline-secondary' title='Persons' id='persons'><Dropdown.Item>One</Dropdown.Item><Dropdown.Item>Two</Dropdown.Item></DropdownButton></InputGroup>
            <Form.Select aria-label='Room' className='mb-2'><option>Any room</option><option>Small room</option></Form.Select>
            <Form.Check type='switch' id='breakfast' label='With breakfast' /><Form.Check inline type='radio' name='bed' id='bed1' label='One bed' defaultChecked /><Form.Check inline type='radio' name='bed' id='bed2' label='Two beds' />
            <Form.Range aria-label='Price' />
            <Button type='submit'>Book</Button> <SplitButton title='Ask' id='ask' variant='secondary'><Dropdown.Item>By mail</Dropdown.Item><Dropdown.Item>By phone</Dropdown.Item></SplitButton> <Button variant='link' onClick={() => setOpen(true)}>Prices</Button>
            <OverlayTrigger trigger='click' placement='right' overlay={<Popover id='pop'><Popover.Body>Dogs may come.</Popover.Body></Popover>}><Button variant='outline-success' size='sm'>Dogs?</Button></OverlayTrigger>
          </Form>
        </Col>
        <Col xs={4}>
          <ButtonGroup className='mb-2'>{['List', 'Map', 'Days'].map((name, i) => <ToggleButton key={name} id={`view-${i}`} type='radio' variant='outline-primary' name='view' value={`${i}`} checked={view === `${i}`} onChange={(event) => setView(event.currentTarget.value)}>{name}</ToggleButton>)}</ButtonGroup>
          <ListGroup>{places.slice(page * 4, page * 4 + 4).map((name) => <ListGroup.Item key={name} action href={`#${name}`}>{name} <Badge bg='secondary'>free</Badge></ListGroup.Item>)}</ListGroup>
          <ReactPaginate className='pagination mt-2' pageClassName='page-item' pageLinkClassName='page-link' previousClassName='page-item' previousLinkClassName='page-link' nextClassName='page-item' nextLinkClassName='page-link' breakClassName='page-item' breakLinkClassName='page-link' activeClassName='active' disabledClassName='disabled' nextLabel='next >' previousLabel='< previous' pageRangeDisplayed={2} marginPagesDisplayed={1} pageCount={6} onPageChange={({selected}) => setPage(selected)} renderOnZeroPageCount={null} />
          <Accordion defaultActiveKey='0'><Accordion.Item eventKey='0'><Accordion.Header>When may I come?</Accordion.Header><Accordion.Body>After noon.</Accordion.Body></Accordion.Item><Accordion.Item eventKey='1'><Accordion.Header>Is there a lift?</Accordion.Header><Accordion.Body>No.</Accordion.Body></Accordion.Item></Accordion>
        </Col>
        <Col xs={4}>
          <Tabs defaultActiveKey='room' className='mb-2'><Tab eventKey='room' title='Room'>A bed and a desk.</Tab><Tab eventKey='house' title='House'>From 1910.</Tab><Tab eventKey='old' title='Old' disabled>Old</Tab></Tabs>
          <Carousel interval={null}>{['#386641', '#6a994e', '#bc4749'].map((colour, i) => <Carousel.Item key={colour}><div style={{height: 180, background: colour}} /><Carousel.Caption><h5>View {i + 1}</h5></Carousel.Caption></Carousel.Item>)}</Carousel>
          <Card className='mt-3'><Card.Header>Breakfast</Card.Header><Card.Body><Card.Text>Bread, cheese and fruit.</Card.Text><Card.Link href='#menu'>Menu</Card.Link></Card.Body></Card>
        </Col>
      </Row>
    </Container>
    <Modal show={open} onHide={() => setOpen(false)}><Modal.Header closeButton><Modal.Title>Prices</Modal.Title></Modal.Header><Modal.Body>40 € a night</Modal.Body><Modal.Footer><Button onClick={() => setOpen(false)}>Close</Button></Modal.Footer></Modal>
    <Offcanvas show={side} onHide={() => setSide(false)}><Offcanvas.Header closeButton><Offcanvas.Title>Filters</Offcanvas.Title></Offcanvas.Header><Offcanvas.Body><Form.Check id='quiet' label='Quiet' /></Offcanvas.Body></Offcanvas>
  </>
}
createRoot(document.getElementById('app')).render(<App />)

import 'vuestic-ui/css'
import {createApp} from 'vue/dist/vue.esm-bundler.js'
import {createVuestic} from 'vuestic-ui'

createApp({
  data: () => ({
    name: 'Ann', town: 'Bonn', towns: ['Bonn', 'Ghent', 'Turin'], some: ['Bonn'], count: 3, on: true, agreed: true, size: 'Small', stars: 3, volume: 40, view: 'list', views: [{label: 'List', value: 'list'}, {label: 'Map', value: 'map'}, {label: 'Days', value: 'days'}], date: new Date(2026, 2, 10), tab: 0, page: 2, open: [true, false], said: '', chosen: [], shown: true, file: [], colour: '#154ec1', time: new Date(2026, 2, 10, 10, 20),
    columns: [{key: 'id', sortable: true}, {key: 'name', sortable: true}, {key: 'town'}, {key: 'actions', width: 80}],
    rows: [['Leanne', 'Bonn'], ['Ervin', 'Ghent'], ['Clementine', 'Turin'], ['Patricia', 'Bonn']].map(([name, town], i) => ({id: i + 1, name, town})),
    nodes: [{id: 1, label: 'Category', children: [{id: 2, label: 'Subcategory'}, {id: 3, label: 'Another'}]}, {id: 4, label: 'Products', children: [{id: 5, label: 'Cameras'}]}],
  }),
  template: `
  <va-navbar color='primary'><template #left><va-navbar-item>Stock</va-navbar-item></template><template #right><va-navbar-item><va-button preset=secondary color=white @click='said = "mail"'>Mail</va-button></va-navbar-item><va-navbar-item><va-button-dropdown label='Account'>Sign out</va-button-dropdown></va-navbar-item></template></va-navbar>
  <div class=row>
  <va-sidebar style='height:640px' width=160px><va-sidebar-item active><va-sidebar-item-content><va-sidebar-item-title>Home</va-sidebar-item-title></va-sidebar-item-content></va-sidebar-item><va-sidebar-item @click='said = "people"'><va-sidebar-item-content><va-sidebar-item-title>People</va-sidebar-item-title></va-sidebar-item-content></va-sidebar-item>
    <va-tree-view :nodes=nodes selectable v-model:checked=chosen expand-all /></va-sidebar>
  <div class=column style='width:230px'><va-input v-model=name label=Name clearable /><va-select v-model=town :options=towns label=Town /><va-select v-model=some :options=towns label=Towns multiple /><va-counter v-model=count label=Count manual-input /><va-date-input v-model=date label=Date /><va-time-input v-model=time label=Time />
    <div style='display:flex;gap:12px'><va-checkbox v-model=agreed label=Agree /><va-switch v-model=on label=Loud size=small /></div><div><va-radio v-model=size :options='["Small", "Large"]' /></div><va-rating v-model=stars /><va-slider v-model=volume track-label-visible /><va-button-toggle v-model=view :options=views preset=secondary border-color=primary /></div>
  <div class=column style='width:500px'><va-tabs v-model=tab><template #tabs><va-tab v-for='one in ["Rows", "Notes"]' :key=one>{{one}}</va-tab><va-tab disabled>Closed</va-tab></template></va-tabs>
    <va-data-table :items=rows :columns=columns selectable clickable @row:click='said = "row"'><template #cell(actions)='{row}'><va-button preset=plain @click.stop='rows = rows.filter((one) => one.id !== row.rowData.id)'>Delete</va-button></template></va-data-table>
    <va-pagination v-model=page :pages=8 :visible-pages=4 /><div><va-chip closeable v-model=shown>Family</va-chip> <va-chip outline>Friends</va-chip></div>
    <va-accordion v-model=open><va-collapse header='First'>One</va-collapse><va-collapse header='Second'>Two</va-collapse></va-accordion>
    <div style='display:flex;gap:8px'><va-button @click='said = "saved"'>Save</va-button><va-button disabled>Send</va-button><va-button-dropdown label=Print split @main-button-click='said = "print"'>On paper</va-button-dropdown><va-color-input v-model=colour /></div><p>{{said}}</p></div>
  <div style='width:270px'><va-date-picker v-model=date /></div></div>`,
}).use(createVuestic()).mount('#app')

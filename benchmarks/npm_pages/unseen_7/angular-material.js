import 'zone.js'
import '@angular/compiler'
import {Component, inject, signal} from '@angular/core'
import {bootstrapApplication} from '@angular/platform-browser'
import {provideAnimations} from '@angular/platform-browser/animations'
import {FormsModule} from '@angular/forms'
import {MatAutocompleteModule} from '@angular/material/autocomplete'
import {MatButtonModule} from '@angular/material/button'
import {MatButtonToggleModule} from '@angular/material/button-toggle'
import {MatCheckboxModule} from '@angular/material/checkbox'
import {MatChipsModule} from '@angular/material/chips'
import {provideNativeDateAdapter} from '@angular/material/core'
import {MatDatepickerModule} from '@angular/material/datepicker'
import {MatExpansionModule} from '@angular/material/expansion'
import {MatFormFieldModule} from '@angular/material/form-field'
import {MatInputModule} from '@angular/material/input'
import {MatListModule} from '@angular/material/list'
import {MatMenuModule} from '@angular/material/menu'
import {MatPaginatorModule} from '@angular/material/paginator'
import {MatRadioModule} from '@angular/material/radio'
import {MatSelectModule} from '@angular/material/select'
import {MatSidenavModule} from '@angular/material/sidenav'
import {MatSlideToggleModule} from '@angular/material/slide-toggle'
import {MatSliderModule} from '@angular/material/slider'
import {MatSnackBar, MatSnackBarModule} from '@angular/material/snack-bar'
import {MatSortModule} from '@angular/material/sort'
import {MatTableModule} from '@angular/material/table'
import {MatTabsModule} from '@angular/material/tabs'
import {MatToolbarModule} from '@angular/material/toolbar'

const rows = [['Hydrogen', 1.0079, 'H'], ['Helium', 4.0026, 'He'], ['Lithium', 6.941, 'Li'], ['Beryllium', 9.0122, 'Be']]

class App {
  bar = inject(MatSnackBar)
  columns = ['position', 'name', 'weight', 'symbol', 'more']
  rows = signal(rows.map(([name, weight, symbol], i) => ({position: i + 1, name, weight, symbol})))
  towns = ['Antwerp', 'Bonn', 'Ghent', 'Turin']
  tags = signal(['metal', 'gas', 'rare'])
  town = ''
  food = 'pizza'
  date = new Date(2026, 2, 10)
  month = new Date(2026, 2, 10)
  agreed = true
  loud = false
  size = 's'
  view = 'list'
  volume = 40
  open() { this.bar.open('Saved', 'Undo') }
  remove(tag) { this.tags.update((tags) => tags.filter((other) => other !== tag)) }
  sort({active, direction}) {
    const sign = direction === 'desc' ? -1 : 1
    this.rows.update((all) => [...all].sort((a, b) => (a[active || 'position'] < b[active || 'position'] ? -sign : sign)))
  }
}

const AppRoot = Component({
  selector: 'app-root',
  imports: [FormsModule, MatAutocompleteModule, MatButtonModule, MatButtonToggleModule, MatCheckboxModule, MatChipsModule, MatDatepickerModule, MatExpansionModule, MatFormFieldModule, MatInputModule, MatListModule, MatMenuModule, MatPaginatorModule, MatRadioModule, MatSelectModule, MatSidenavModule, MatSlideToggleModule, MatSliderModule, MatSnackBarModule, MatSortModule, MatTableModule, MatTabsModule, MatToolbarModule],
  template: `
  <mat-toolbar color="primary"><button mat-icon-button (click)="side.toggle()" aria-label="Menu">≡</button><span style="flex:1">Elements</span><button mat-button [matMenuTriggerFor]="file">File</button><button mat-button (click)="open()">Save</button></mat-toolbar>
  <mat-menu #file="matMenu"><button mat-menu-item>New</button><button mat-menu-item>Open</button><button mat-menu-item disabled>Print</button></mat-menu>
  <mat-sidenav-container class="page">
    <mat-sidenav #side mode="side" opened><mat-nav-list><a mat-list-item href="#home" activated>Home</a><a mat-list-item href="#tables">Tables</a><a mat-list-item href="#people">People</a></mat-nav-list>
      <mat-selection-list [multiple]="false"><mat-list-option value="a" selected>Boots</mat-list-option><mat-list-option value="b">Clogs</mat-list-option><mat-list-option value="c">Loafers</mat-list-option></mat-selection-list></mat-sidenav>
    <mat-sidenav-content><div class="grid">
      <div class="column" style="width:260px">
        <mat-form-field appearance="outline"><mat-label>Name</mat-label><input matInput></mat-form-field>
        <mat-form-field><mat-label>Favourite food</mat-label><mat-select [(ngModel)]="food"><mat-option value="steak">Steak</mat-option><mat-option value="pizza">Pizza</mat-option><mat-option value="tacos">Tacos</mat-option></mat-select></mat-form-field>
        <mat-form-field><mat-label>Town</mat-label><input matInput [(ngModel)]="town" [matAutocomplete]="auto"><mat-autocomplete #auto="matAutocomplete">@for (one of towns; track one) {<mat-option [value]="one">{{one}}</mat-option>}</mat-autocomplete></mat-form-field>
        <mat-form-field><mat-label>Choose a date</mat-label><input matInput [matDatepicker]="picker" [(ngModel)]="date"><mat-datepicker-toggle matIconSuffix [for]="picker" /><mat-datepicker #picker /></mat-form-field>
        <mat-checkbox [(ngModel)]="agreed">Agree</mat-checkbox><mat-slide-toggle [(ngModel)]="loud">Loud</mat-slide-toggle>
        <mat-radio-group [(ngModel)]="size" aria-label="Size"><mat-radio-button value="s">Small</mat-radio-button><mat-radio-button value="l">Large</mat-radio-button></mat-radio-group>
        <mat-slider min="0" max="100" step="5" discrete><input matSliderThumb [(ngModel)]="volume"></mat-slider>
      </div>
      <div class="column" style="width:440px">
        <mat-tab-group><mat-tab label="Table">
          <table mat-table [dataSource]="rows()" matSort (matSortChange)="sort($event)">
            <ng-container matColumnDef="position"><th mat-header-cell *matHeaderCellDef mat-sort-header>No.</th><td mat-cell *matCellDef="let row">{{row.position}}</td></ng-container>
            <ng-container matColumnDef="name"><th mat-header-cell *matHeaderCellDef mat-sort-header>Name</th><td mat-cell *matCellDef="let row">{{row.name}}</td></ng-container>
            <ng-container matColumnDef="weight"><th mat-header-cell *matHeaderCellDef mat-sort-header>Weight</th><td mat-cell *matCellDef="let row">{{row.weight}}</td></ng-container>
            <ng-container matColumnDef="symbol"><th mat-header-cell *matHeaderCellDef>Symbol</th><td mat-cell *matCellDef="let row">{{row.symbol}}</td></ng-container>
            <ng-container matColumnDef="more"><th mat-header-cell *matHeaderCellDef></th><td mat-cell *matCellDef="let row"><button mat-icon-button [matMenuTriggerFor]="file" [attr.aria-label]="'More of ' + row.name">⋮</button></td></ng-container>
            <tr mat-header-row *matHeaderRowDef="columns"></tr><tr mat-row *matRowDef="let row; columns: columns"></tr>
          </table>
          <mat-paginator [length]="100" [pageSize]="10" [pageSizeOptions]="[5, 10, 25]" showFirstLastButtons aria-label="Page" />
        </mat-tab><mat-tab label="Notes">No notes</mat-tab><mat-tab label="Closed" disabled>Closed</mat-tab></mat-tab-group>
        <mat-chip-grid #grid aria-label="Tags">@for (tag of tags(); track tag) {<mat-chip-row (removed)="remove(tag)">{{tag}}<button matChipRemove [attr.aria-label]="'remove ' + tag">✕</button></mat-chip-row>}<input placeholder="New tag" [matChipInputFor]="grid"></mat-chip-grid>
        <mat-chip-listbox aria-label="Fish"><mat-chip-option selected>Trout</mat-chip-option><mat-chip-option>Perch</mat-chip-option><mat-chip-option disabled>Salmon</mat-chip-option></mat-chip-listbox>
      </div>
      <div class="column" style="width:290px">
        <mat-calendar [(selected)]="month" [startAt]="month" />
        <mat-accordion><mat-expansion-panel expanded><mat-expansion-panel-header><mat-panel-title>Person</mat-panel-title><mat-panel-description>A name</mat-panel-description></mat-expansion-panel-header><p>Ann</p></mat-expansion-panel><mat-expansion-panel><mat-expansion-panel-header><mat-panel-title>Place</mat-panel-title></mat-expansion-panel-header><p>Bonn</p></mat-expansion-panel></mat-accordion>
        <mat-button-toggle-group [(ngModel)]="view" aria-label="View"><mat-button-toggle value="list">List</mat-button-toggle><mat-button-toggle value="map">Map</mat-button-toggle><mat-button-toggle value="days">Days</mat-button-toggle></mat-button-toggle-group>
      </div>
    </div></mat-sidenav-content>
  </mat-sidenav-container>`,
})(App)
bootstrapApplication(AppRoot, {providers: [provideAnimations(), provideNativeDateAdapter()]})

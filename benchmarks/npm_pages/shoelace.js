import '@shoelace-style/shoelace/dist/shoelace.js'

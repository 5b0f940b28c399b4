import '@carbon/web-components/es/index.js'

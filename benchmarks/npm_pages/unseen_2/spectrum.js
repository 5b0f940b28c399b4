import '@spectrum-web-components/bundle/elements.js'

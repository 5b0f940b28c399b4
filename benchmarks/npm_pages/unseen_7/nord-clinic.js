import '@nordhealth/components'

const icon = async (name) => (await fetch(`/node_modules/@nordhealth/icons/lib/assets/${name}.svg`)).text()
customElements.get('nord-icon').registerResolver(icon)

import '@github/tab-container-element'

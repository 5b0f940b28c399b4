import '@umbraco-ui/uui'

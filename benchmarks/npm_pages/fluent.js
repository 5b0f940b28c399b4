import * as fluent from '@fluentui/web-components'
fluent.provideFluentDesignSystem().register(fluent.allComponents)

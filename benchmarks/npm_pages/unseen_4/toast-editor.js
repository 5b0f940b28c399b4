import Editor from '@toast-ui/editor'
new Editor({el: document.querySelector('#editor'), height: '450px', initialEditType: 'markdown', previewStyle: 'vertical',
  initialValue: '# Fruits\n\n* [ ] Apples\n* [x] Pears\n\n| Name | Price |\n| --- | --- |\n| Plum | 3 |\n\n[More](#more)', usageStatistics: false})

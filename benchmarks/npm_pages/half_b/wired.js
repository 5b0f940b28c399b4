import 'wired-elements'

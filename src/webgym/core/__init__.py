"""What all packages share: types, settings, tables, figures. No import from any other package."""

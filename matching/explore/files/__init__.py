"""Files that are edited in the browser: values, forms, undo, saving with comments kept."""

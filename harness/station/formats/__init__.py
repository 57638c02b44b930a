"""What a mission looks like in each kind of file: `read(data)` and `write(draft, name)` in a module each."""

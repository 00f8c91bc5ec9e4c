"""Maps of Deep RTS: files, formats, generator and padding."""

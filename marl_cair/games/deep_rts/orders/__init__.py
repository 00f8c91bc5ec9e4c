"""Orders of Deep RTS: what actions do, when they are legal, and the cursor."""

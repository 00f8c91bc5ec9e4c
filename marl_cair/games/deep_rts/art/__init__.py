"""Draws Deep RTS: sprites, images for people and the representations `image` and `gray`."""

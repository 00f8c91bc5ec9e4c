"""Games in a browser: rules compiled to WebAssembly, a page to play on, a server on loopback."""

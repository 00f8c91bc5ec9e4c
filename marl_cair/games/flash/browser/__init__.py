"""Runs a SWF in Chromium: server, display, page, VNC client, and what must be installed."""

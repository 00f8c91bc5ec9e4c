"""Flash games in a browser on a virtual display, steered over VNC or a page socket."""

"""Parts of ``dart-hal demo``: map, diagnosis, real recordings, and the page of them."""

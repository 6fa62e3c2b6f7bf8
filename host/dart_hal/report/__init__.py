"""Pictures as files, and what several rooms draw of recordings."""

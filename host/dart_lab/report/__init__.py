"""The kit of all reports: page builder, charts and pictures. What a page says, its room knows."""

"""Motions in a browser: what plays, what is drawn, and the page that shows it."""

"""What a run looks like: charts, snapshot strips, the page; the only door to matplotlib."""

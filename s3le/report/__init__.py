"""What a run looks like: charts, snapshot strips and the page that reads them; the only door to matplotlib."""

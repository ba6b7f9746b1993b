"""The comparison of methods: what each answers, how it is measured, what the tables say."""

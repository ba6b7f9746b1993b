def stream() -> None:
    pass

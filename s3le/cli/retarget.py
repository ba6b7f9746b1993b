def retarget() -> None:
    pass

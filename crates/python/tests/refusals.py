"""What the scripts of this folder share."""


def refused(kind, parts, call):
    try:
        call()
    except kind as error:
        assert all(part in str(error) for part in parts), (str(error), parts)
    else:
        raise AssertionError(f"{parts} was not refused")

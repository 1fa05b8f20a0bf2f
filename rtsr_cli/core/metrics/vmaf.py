def default_model(h):
    return "m"


def check_available():
    pass


class Vmaf:
    pass

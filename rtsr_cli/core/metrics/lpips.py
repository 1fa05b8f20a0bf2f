class Lpips:
    pass

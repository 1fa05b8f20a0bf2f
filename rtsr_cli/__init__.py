"""rtsr: neural reconstruction for real-time rendering over folders of EXR G-buffer frames."""

__version__ = "0.1.0"

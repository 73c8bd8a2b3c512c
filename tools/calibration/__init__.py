"""The parts of tools/calibrate.py: pictures, boards, cameras, what spoils them, and files."""


class Refused(Exception):
    """What the user gave cannot be used: one line that names the file or option and the reason."""

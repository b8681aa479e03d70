"""What a job would do to the machine, found before the first byte is sent: files are sent as they are written."""

from printer_slicer.policy.findings import NAMES, Finding, check_names, insist, remedy_of, sentence
from printer_slicer.policy.scan import scan

__all__ = ["NAMES", "Finding", "check_names", "insist", "remedy_of", "scan", "sentence"]

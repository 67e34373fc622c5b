"""The version of bfrt, for what is written."""

VERSION = "0.1.0"

"""The version of rigmatch, in this one place."""

VERSION = "0.2.0.dev0"

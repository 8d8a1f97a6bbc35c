"""The `ballbot` command."""

"""Worlds as machines describe and cameras show them: does every published motion hold in truth?"""

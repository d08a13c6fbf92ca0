"""Watching agents with a channel, speaking to them, and looking at what each message would do, in the browser."""

"""What a run leaves behind: messages, tracks and digest; `read/` reads recordings back."""

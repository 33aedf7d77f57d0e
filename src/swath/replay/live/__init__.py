"""A run that is watched while it goes on: the page of the replay, fed over a websocket, with run control.

`data`: what the page begins with; `frames`: what is sent while the run goes on; `server`: page, websockets;
`view`: the run hook that joins them.
"""

"""replay.html: a run as one page to look at, from the run folder and the field it was driven in.

`writer.write_replay` reads what the run left (tracks, recording, summary), takes the field from the scenario,
and puts both, packed as typed arrays, into a page whose scripts are the files of `page/`. The page loads
nothing and needs a browser with WebGL 2.
"""

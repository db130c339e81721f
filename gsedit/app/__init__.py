"""The page in the browser: open, point, say, compare, keep.

Four rooms of thought, from the bottom up:

- `document` is what is kept: the steps of a session and where one is in them, as one file.
- `worker` runs one command line of gsedit at a time in a process of its own, which has loaded
  everything before it is asked. What lasts longer than a click is such a command line: edits, fits,
  captures, exports. It can be cancelled at any time, for commands write whole files only.
- `frames` draws for one tab: the newest camera, coarse while it moves.
- `page` and `tab` hold all state: `Page` what all tabs share (document, scene, selection, the work
  in hand), `Tab` what one browser tab has (camera, preview, comparison, pointer, notices).

A panel is a function `add(page, tab)` in `panels`, which puts controls into `tab.gui`.
"""

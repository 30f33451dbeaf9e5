"""What one visitor of the page may use of it: the limits in time, number and size.

`docs/reference/limits.md` lists them. They leave room for the fastest hand: a held key
repeats some 30 to 100 times a second, the camera and a slider move at most 50 times a
second.
"""

REQUEST_S = 10.0
"""A connection that has not sent a whole request by then is closed."""
IDLE_S = 60.0
"""A connection is closed that long after its last request."""
WAITING = 256
"""Connections without an open page; of more, the address that has most loses its
oldest. Behind a reverse proxy all come from one address, and the oldest goes."""
WAITING_SHARE = 0.25
"""Part of the process's open files that these may take, where that is less."""
FORM_BYTES = 2**14
"""Longest form."""
LOGIN_FAILURES_PER_MINUTE = 10
"""Wrong tokens an address may try."""
REQUESTS_PER_S = 10.0
"""Pages (figures, guidelines) a rater may ask for; more are refused for a moment."""
REQUESTS_AT_ONCE = 40.0
"""Requests that may come at once, after a pause."""

PAGES = 40
"""Open labeling pages in all, unless `--most-raters` says otherwise."""
FULL_S = 60.0
"""How often who finds no place asks again, with the page left open."""
FULL_WAIT_S = 1800.0
"""When to come back where nobody has left yet."""
PAGES_PER_RATER = 1
"""A newer one closes the oldest."""
OPENINGS_PER_S = 1.0
"""How often a rater's page may be opened anew; more wait for their turn."""
OPENINGS_AT_ONCE = 5.0
"""Openings that may come at once, after a pause."""
WATCH_S = 0.25
"""How often it is looked whether the rater of an open page may still be there."""
CLOSE_S = 1.0
"""A browser that does not say goodbye by then is left."""

MESSAGE_BYTES = 2**20
"""Longest message of a browser."""
MESSAGES_PER_S = 200.0
"""Messages of a rater; more are read later, so that they wait at the sender."""
MESSAGES_AT_ONCE = 400.0
"""Messages that may come at once, after a pause."""
MESSAGE_UNIT_BYTES = 2**12
"""A long message counts as one for each of these."""
FLOOD_S = 5.0
"""A page whose messages have waited for so long without a pause is closed."""
EVENTS_PER_TURN = 16
"""Events of one page that are handled before it is the next page's turn."""
ACTIONS_WAITING = 8
"""Answers, undos and the like of one page that wait to be stored; more are dropped."""
CHANGES_PER_S = 8.0
"""Switches of view, plots, theme and dialogs of one page; more are dropped."""
CHANGES_AT_ONCE = 8.0
"""Changes that may come at once, after a pause."""

INNER_WAITING = 32
"""Connections to viser that have not yet said who they are."""
LOG_LINES_PER_MINUTE = 20
"""Lines of one kind in the log; the rest is counted."""

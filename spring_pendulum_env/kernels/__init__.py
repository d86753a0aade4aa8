"""The compiled step, for one pendulum and for many. It holds no formula of its own.

Both run the same functions on pendulums side by side (`lanes.Lanes`), one or WIDTH of them: the loops over pendulums
are innermost, and root and division vectorise (where there is one pendulum, the loops vanish). Without any fastmath
flag the arithmetic is IEEE's in either case, so that a pendulum gets the same bits alone and among others.

Each comes in two forms, by the splitting (`single`, `batch`) and by the adaptive scheme (`adaptive`), so that whoever
uses one of them needn't wait for the other to be compiled; what the splitting can't do is UNFINISHED after it.
"""

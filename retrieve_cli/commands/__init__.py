"""The command line's words: every command with its options and help. The work is done in the module of the command's name.

A command reads its options and returns the job to do; `retrieve_cli.app.parse` hands it to `__main__`, which runs it. So nothing heavy is
imported before it is needed, and how a command ends is decided in one place (`errors.guarded`). A new command needs a function here, its
name in `retrieve_cli/app.py`, and a module `retrieve_cli/NAME.py` with `run(*, …) -> int | None`, which returns the exit code and raises
InputError.
"""

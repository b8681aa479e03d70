"""The commands of the command line, a module each; `cli.parser.COMMANDS` is the table of them.

A module has the name of its command, with _ for - and spaces. It holds `EXAMPLES` for the help, `add_arguments(parser)`
and `run(arguments)`, which returns the exit code. It is imported only when its command is asked for, and its imports at
the top are light, because `--help` needs them; what the work needs is imported by the functions that do it.
"""

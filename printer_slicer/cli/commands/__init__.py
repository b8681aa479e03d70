"""The commands of the command line, one module each; the table `cli.parser.COMMANDS` lists them.

A module has the name of its command, with _ for - and spaces. It contains `EXAMPLES` for the help,
`add_arguments(parser)`, and `run(arguments)`, which returns the exit code. The module is imported only when its command
is requested. Its imports at the top are light, because `--help` needs them; functions import what only they need.
"""

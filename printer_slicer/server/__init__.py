"""Web server: a page, the queue, and the interfaces that slicers use to send files.

browser, slicers -- HTTP, WebSocket --> server (one process, asyncio)
                                          |- `print_queue`: files, jobs, printers, in SQLite
                                          |- worker processes that read files and slice models
                                          `- control sockets <-- one process per print --> printer

The server opens no serial port: each print that it starts is a separate process, which continues if the server dies.
Everything that changes a print passes through `print_queue` or the control socket of the print, as on the command line.
"""

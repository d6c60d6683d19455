# SPDX-License-Identifier: MIT
"""Shows a run while it goes on, and makes its recording when it is over.

    source (stdin, file, Unix socket, UDP)  ->  kept log on the disk  ->  after the end: the recording, as of any log
                                            ->  bounded queue  ->  thread that serves viewers

What is kept does not wait for viewers: the queue drops its oldest steps instead, and they are counted.
"""

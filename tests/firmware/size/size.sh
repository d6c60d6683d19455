#!/bin/sh
# SPDX-License-Identifier: MIT
# What a node needs of flash, RAM, stack and instructions against limits.json: lines "ok" and "not ok". Usage: size.sh BUILD
# Reads what make size-images made.
.venv/bin/python tests/firmware/size/size.py "$1" --check
status=$?
# 1 says only that there are lines "not ok".
[ $status -le 1 ]

#!/bin/sh
# SPDX-License-Identifier: MIT
# What sealing costs against limits: lines "ok" and "not ok". Usage: sealed.sh BUILD
# Reads what make firmware and make size-images made.
.venv/bin/python tests/firmware/sealed/size.py "$1" --check

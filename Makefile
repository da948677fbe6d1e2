# SPDX-License-Identifier: GPL-2.0-or-later
# The front door. Does nothing itself: everything is in tools/.
#
#   CLIP=my.y4m    the clip for `make run`
#   ACCEL=tcg|kvm  QEMU's acceleration, instead of finding out what works
#   T=...          which tests, as pytest's -k expression

PYTHON = /usr/bin/python3 -B

.PHONY: help setup setup-build build run test lint clean distclean

help:            ## this list
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  make \1\t\2/p' Makefile | expand -t 20
setup:           ## install what building and testing need (Debian packages)
	@tools/setup
setup-build:
	@tools/setup build
build: setup-build  ## build the programs and the development image, output/dev/disk.img
	@$(PYTHON) tools/build.py
run: setup-build ## a clip through the appliance in QEMU, frame by frame; output/report.json
	@$(PYTHON) tools/run.py "$(CLIP)"
test: setup      ## all tests
	@$(PYTHON) tools/test.py $(T)
lint: setup      ## check scripts, tools and sources without running them
	@$(PYTHON) tools/lint.py
clean:           ## remove what was built, keep what was downloaded
	@tools/clean
distclean:       ## remove all output
	@tools/clean all

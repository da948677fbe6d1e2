# SPDX-License-Identifier: GPL-2.0-or-later
# The rules for settings, read by `service` (with merge.awk) and settings-copy (with restore.awk). Settings come from a
# technician, a test disk or a copy, and root's scripts use them, so only one form of each value is accepted.

# Splits the line $0 into `key` and `value`. 0: not a setting; then `ignored` has the reason, or is empty for a comment.
function is_setting(at) {
	sub(/\r$/, "")
	sub(/^[ \t]+/, "")
	sub(/[ \t]+$/, "")
	ignored = ""
	if (/^#/ || /^$/) return 0
	if (!/^[A-Za-z][A-Za-z0-9_-]*[ \t]*=/ || /[[:cntrl:]]/) {
		ignored = "is not key=value, ignored"
		return 0
	}
	at = index($0, "=")
	key = substr($0, 1, at - 1)
	value = substr($0, at + 1)
	sub(/[ \t]+$/, "", key)
	sub(/^[ \t]+/, "", value)
	return 1
}

function is_number(least, most) {
	return value ~ /^-?[0-9]+$/ && length(value) <= 5 && value + 0 >= least && value + 0 <= most
}

# The form that is needed instead of `value`; empty if the value is right. The program itself checks its options.
function wanted() {
	if (key ~ /^(enabled|once)$/) return value ~ /^(yes|no)$/ ? "" : "yes or no"
	if (key == "oom_score_adj") return is_number(-1000, 1000) ? "" : "a number from -1000 to 1000"
	if (value == "") return ""
	if (key == "memory_limit") return value ~ /^[1-9][0-9]?[0-9]?[0-9]?M$/ ? "" : "megabytes from 1M to 9999M"
	if (key == "stop_seconds") return is_number(1, 30) ? "" : "a number from 1 to 30"
	if (key == "user") return value ~ /^[a-z_][a-z0-9_-]*$/ ? "" : "a user's name"
	if (key == "priority") return is_number(-20, 19) ? "" : "a number from -20 to 19"
	if (key == "realtime") return is_number(1, 99) ? "" : "a number from 1 to 99"
	# Patterns of paths are strings: between slashes each slash needs a backslash, which BusyBox would then accept, too.
	if (key == "mounted") return value ~ "^/[A-Za-z0-9/_-]+$" ? "" : "a path of letters, digits, / _ and -"
	if (key == "needs") return value ~ "^/[A-Za-z0-9/_.:,+@-]+$" ? "" : "a path of letters, digits and / _ . : , + @ -"
	return ""
}

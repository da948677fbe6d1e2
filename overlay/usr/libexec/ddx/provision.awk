# SPDX-License-Identifier: GPL-2.0-or-later
# Checks ddx.txt: prints valid lines in a normalized form, and on standard error the fault of each other line. A
# wireless network is printed as wifi=NAME PASSPHRASE, its name in hexadecimal digits; a passphrase without quotes.

# A line that may contain a passphrase is not shown, since errors are on screens and in logs.
function wrong(why, line) {
	line = raw
	if (!at) sub(/ .*/, " ...", line)
	else if (key !~ /^(console|country|dns|hostname|network|ntp|service|ssh_key|test)$/) line = key "=..."
	tell(NR, line, why)
	bad = 1
}

function tell(number, line, why) {
	gsub(/[^ -~]/, "?", line)
	print "ddx.txt, line " number ": " substr(line, 1, 60) ": " why > "/dev/stderr"
}

# Four numbers up to 255.
function is_address(text, parts, i) {
	if (text !~ /^[0-9]+\.[0-9]+\.[0-9]+\.[0-9]+$/) return 0
	split(text, parts, ".")
	for (i = 1; i <= 4; i++)
		if (length(parts[i]) > 3 || parts[i] > 255) return 0
	return 1
}

function is_network(text, parts) {
	return split(text, parts, "/") == 2 && is_address(parts[1]) && parts[2] ~ /^[0-9]+$/ && parts[2] >= 1 && parts[2] <= 32
}

function is_host(text) {
	return length(text) <= 253 && text ~ /^[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?$/
}

function is_service(name, line) {
	return name ~ /^[A-Za-z0-9_-]+$/ && (getline line < (defaults "/" name)) >= 0
}

function once(what) {
	if (what in seen) wrong("line " seen[what] " has set this already")
	seen[what] = NR
	return !bad
}

function network(count, words) {
	count = split(value, words, " ")
	if (words[1] !~ /^[a-z][a-z0-9]*$/ || length(words[1]) > 15)
		wrong("an interface is needed first: network=eth0 dhcp")
	else if (!(count == 2 && words[2] == "dhcp") &&
	         !(is_network(words[2]) && (count == 2 || (count == 3 && is_address(words[3])))))
		wrong("dhcp is needed, or an address and its network, and if there is one a gateway: eth0 192.168.1.5/24 192.168.1.1")
	else if (once("network " words[1]) && words[1] ~ /^wl/)
		wireless[++wireless_count] = NR
}

# The next word of `rest`, or the text between quotes (a quote inside is written twice); it is removed from `rest`.
function next_word(word, at) {
	quoted = substr(rest, 1, 1) == "\""
	if (!quoted) {
		match(rest, /^[^ ]*/)
		word = substr(rest, 1, RLENGTH)
		rest = substr(rest, RLENGTH + 1)
		broken = index(word, "\"") > 0
	} else {
		rest = substr(rest, 2)
		word = ""
		while ((at = index(rest, "\"")) && substr(rest, at + 1, 1) == "\"") {
			word = word substr(rest, 1, at)
			rest = substr(rest, at + 2)
		}
		word = word substr(rest, 1, at - 1)
		rest = substr(rest, at + 1)
		broken = !at || rest ~ /^[^ ]/
	}
	sub(/^ +/, "", rest)
	return word
}

function hexadecimal(text, i, digits) {
	for (i = 1; i <= length(text); i++) digits = digits sprintf("%02x", code[substr(text, i, 1)])
	return digits
}

# Whether a line with a passphrase has characters that only look like what was meant.
function is_mistyped() {
	if (value ~ /\342\200[\234-\236]/)
		wrong("straight quotes are needed: \"")
	else if (value ~ /[\001-\037\177]/)
		wrong("it has an invisible character; type the line again")
	return bad
}

function wifi(name, phrase, bare) {
	wireless_lines++
	rest = value
	name = next_word()
	if (!broken) phrase = next_word()
	bare = !quoted
	if (is_mistyped())
		return
	if (broken || rest != "")
		wrong("quotes are needed around what has spaces in it: wifi=\"Robot Hall\" \"pass phrase\"; a quote in there twice")
	else if (name == "" || length(name) > 32)
		wrong("a network's name is needed first, of 32 bytes at most: wifi=hall passphrase")
	else if (phrase == "")
		wrong("a passphrase is needed, or, for a network without one, the word open: wifi=hall open")
	else if (phrase ~ /[^ -~]/)
		wrong("a passphrase has letters from A to Z, digits and signs only")
	else if (!(phrase == "open" && bare) && (length(phrase) < 8 || length(phrase) > 63) &&
	         !(length(phrase) == 64 && phrase ~ /^[0-9A-Fa-f]+$/))
		wrong("a passphrase has 8 to 63 characters, this one " length(phrase))
	else if (once("wifi " name))
		value = hexadecimal(name) " " phrase
	wireless_networks += !bad
}

function panel(phrase) {
	rest = value
	phrase = next_word()
	if (is_mistyped())
		return
	if (broken || rest != "")
		wrong("quotes are needed around what has spaces in it: panel=\"pass phrase\"; a quote in there twice")
	else if (phrase ~ /[^ -~]/)
		wrong("a passphrase has letters from A to Z, digits and signs only")
	else if (length(phrase) < 12 || length(phrase) > 128)
		wrong("a passphrase has 12 to 128 characters, this one " length(phrase))
	else if (once(key))
		value = phrase
}

function service(count, words) {
	sub(/^(catalog|decode|store)( |$)/, "ddx&", value) # the names before release 0.3.0
	count = split(value, words, " ")
	if (!is_service(words[1]))
		wrong("there is no service '" words[1] "'; there are: " services)
	else if (count != 2 || words[2] !~ /^(on|off)$/)
		wrong("on or off is needed: service=" words[1] " on")
	else
		once("service " words[1])
}

function each(what, kind, count, words, i) {
	count = split(value, words, " ")
	if (!count) wrong(kind " is needed")
	for (i = 1; i <= count; i++)
		if (!(what == "dns" ? is_address(words[i]) : is_host(words[i]))) {
			wrong("'" words[i] "' is not " kind)
			return
		}
	once(what)
}

BEGIN { for (i = 1; i < 256; i++) code[sprintf("%c", i)] = i }
NR == 1 { sub(/^\357\273\277/, "") } # some editors begin a file like this
{
	sub(/\r$/, "")
	typed = $0
	gsub(/\t/, " ")
	sub(/^ +/, "")
	sub(/ +$/, "")
}
/^#/ || /^$/ { next }
{
	bad = 0
	raw = $0
	at = index($0, "=")
	key = substr($0, 1, at - 1)
	value = substr($0, at + 1)
	sub(/ +$/, "", key)
	sub(/^ +/, "", value)
	if (key == "wifi" || key == "panel") { # as typed: spaces may belong to a name or a passphrase
		value = substr(typed, index(typed, "=") + 1)
		gsub(/^[ \t]+|[ \t]+$/, "", value)
	} else
		gsub(/  +/, " ", value)
	if (!at)
		wrong("key=value is needed")
	else if (key == "hostname") {
		if (value !~ /^[a-z0-9]([a-z0-9-]*[a-z0-9])?$/ || length(value) > 63)
			wrong("small letters, digits and inner hyphens are needed, 63 at most")
		else
			once(key)
	} else if (key == "console") {
		if (value !~ /^(open|closed)$/) wrong("open or closed is needed")
		else once(key)
	} else if (key == "test") {
		if (value !~ /^(yes|no)$/) wrong("yes or no is needed")
		else once(key)
	} else if (key == "ssh_key") {
		if (value !~ /^(ssh-ed25519|ssh-rsa|ecdsa-sha2-nistp(256|384|521)|sk-[a-z0-9@.-]+) AAAA[A-Za-z0-9+\/]+=*( [ -~]*)?$/)
			wrong("a public key is needed, as in a file that ends in .pub")
	} else if (key == "country") {
		if (value !~ /^[A-Z][A-Z]$/) wrong("two capital letters are needed: country=DE")
		else once(key)
	} else if (key == "wifi")
		wifi()
	else if (key == "panel")
		panel()
	else if (key == "network")
		network()
	else if (key == "dns")
		each(key, "an address")
	else if (key == "ntp")
		each(key, "a host's name or address")
	else if (key == "service")
		service()
	else
		wrong("not a key; there are: console country dns hostname network ntp panel service ssh_key test wifi")
	if (!bad) good[NR] = key "=" value
}
END {
	for (i = 1; i <= wireless_count; i++)
		if (!wireless_networks) {
			# Not after a wrong wifi line, which has been reported already.
			if (!wireless_lines)
				tell(wireless[i], good[wireless[i]], "which network? wifi=NAME PASSPHRASE is needed, too")
			delete good[wireless[i]]
		}
	for (i = 1; i <= NR; i++) {
		if (!(i in good)) continue
		if (good[i] ~ /^wifi=/ && !wireless_count) tell(i, "wifi=...", "network=wlan0 dhcp is needed, too")
		else print good[i]
	}
}

/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXPANEL_WEB_H
#define DDXPANEL_WEB_H

/*
 * The web process: takes requests of the web server from `listener` (SCGI), and sends logins and orders to the process
 * of root by the socket `root`, with a sign of life each 3 s. No visitor waits for another. Returns only on an error,
 * which is -errno.
 */
int web_serve(int listener, int root);

#endif

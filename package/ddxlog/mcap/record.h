/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Constants of the format, for writer and reader. */
#ifndef DDXLOG_RECORD_H
#define DDXLOG_RECORD_H

#include "mcap.h"

#define MCAP_MAGIC "\x89MCAP0\r\n"
#define MCAP_MAGIC_SIZE 8
#define MCAP_RECORD_HEAD 9 /* opcode, length */
#define MCAP_CHUNK_HEAD 32 /* up to the length of the name of the compression */

enum mcap_opcode {
    MCAP_HEADER = 1,
    MCAP_FOOTER,
    MCAP_SCHEMA,
    MCAP_CHANNEL,
    MCAP_MESSAGE,
    MCAP_CHUNK,
    MCAP_MESSAGE_INDEX,
    MCAP_CHUNK_INDEX,
    MCAP_ATTACHMENT,
    MCAP_ATTACHMENT_INDEX,
    MCAP_STATISTICS,
    MCAP_METADATA,
    MCAP_METADATA_INDEX,
    MCAP_SUMMARY_OFFSET,
    MCAP_DATA_END,
    MCAP_OPCODE_END
};

#endif

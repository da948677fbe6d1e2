/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * How one worker of the store replaces another (package/ddx/store/holder.h, checkpoint.h), and one whole store another,
 * for Spin: README.md lists what is modelled and what is not. Names are those of the code. A statement outside atomic
 * and d_step is one step, and others may act before and after it. FAULT_... switches a fault on, for a run that must
 * fail.
 */
#ifndef CRASHES
#define CRASHES 1 /* of workers, each replaced by one with the committed state */
#endif
#ifndef DEATHS
#define DEATHS 0 /* of holders, each replaced by a store without any state */
#endif
#ifndef STOPS
#define STOPS 0 /* of clients, for ever; a client that continues is only slow, as each may be at any time */
#endif
#ifndef HANGUPS
#define HANGUPS 0 /* of the store on a reader, without room or descriptors */
#endif
#ifndef ASKS
#define ASKS 1 /* requests of the first reader, in sequence: to be admitted, then for more room */
#endif
#ifndef SECOND
#define SECOND 1 /* of the second reader */
#endif
#ifndef WRITER_ASKS
#define WRITER_ASKS 0 /* of the writer, whose handle also reads */
#endif
#ifndef UNREAD
#define UNREAD 0 /* messages that the writer has not read at the beginning */
#endif
#define ROOM 2 /* messages in a socket, in either direction */
#define CLIENTS 3
#define WRITER 0 /* the others read */

/* wire.h: requests, each with a number and its arguments */
#define ATTACH 1 /* pin page: of a new reader, else it asks for more room */
#define OFFER 2 /* all of OFFER .. OFFER_END. Reader: pin page, share. Writer: newest notice seen, share. */
chan request[CLIENTS] = [ROOM] of { byte, byte, byte, byte };
/* Messages of the store, each with a number */
#define SLOT 0 /* or any message without effect here */
#define ANSWER 1 /* ATTACHED and EPOCH: now it may pin */
#define OFFERED 2
#define READER(page, version) ((version) * 4 + (page)) /* to the writer; a version is never 0 */
#define IS_READER(what) ((what) > 3)
#define PAGE(what) ((what) & 3)
#define VERSION(what) ((what) >> 2)
#define VERSIONS 8
#define OWN_PAGE 3 /* of the writer; readers have 0 and 1, and 2 */
chan said[CLIENTS] = [ROOM] of { byte, byte };
/* Messages in a queue: the first in the low bits. */
#define BITS 5
#define FIRST(c) (store.queue[c] & ((1 << BITS) - 1))
#define QUEUED_MAX 6

/* ---- shared memory ---- */
byte notice; /* version; store and writer share the page, which outlives any store */
byte pinned; /* a bit for each page: it holds a frame, from now on */

/* ---- state of a worker ---- */
typedef Store {
    bool back = true; /* the writer is known */
    byte announced;
    byte handled[CLIENTS];
    byte share[CLIENTS]; /* effect of its requests: frames kept for it */
    byte behind[CLIENTS];
    byte page[CLIENTS];
    byte number[CLIENTS]; /* struct ddx_queue */
    byte count[CLIENTS];
    int queue[CLIENTS]
};
Store store; /* of the running worker */
Store kept; /* as committed last. Of the two copies a flip makes the new one valid: one step. */

/* ---- the kernel's ---- */
byte stores;           /* whole ones that have died */
byte own[CLIENTS];     /* the number of the store that this client is connected to */
bool hung_up[CLIENTS]; /* by the store that lives */

/* ---- only for the properties ---- */
byte crashes, stops, hangups;
bool waits[CLIENTS]; /* for an answer */
byte answered[CLIENTS];
bool stopped[CLIENTS];
byte known; /* to the writer: a bit for each page */

#define COPY_CLIENT(to, from, c) \
    to.handled[c] = from.handled[c]; to.share[c] = from.share[c]; \
    to.behind[c] = from.behind[c]; to.page[c] = from.page[c]; to.number[c] = from.number[c]; \
    to.count[c] = from.count[c]; to.queue[c] = from.queue[c]
#define COPY(to, from) \
    to.back = from.back; to.announced = from.announced; \
    COPY_CLIENT(to, from, 0); COPY_CLIENT(to, from, 1); COPY_CLIENT(to, from, 2)
#define FORGET_CLIENT(s, c) \
    s.handled[c] = 0; s.share[c] = 0; s.behind[c] = 0; s.page[c] = 0; s.number[c] = 0; \
    s.count[c] = 0; s.queue[c] = 0
#define DRAIN(c) do :: len(request[c]) -> request[c]?_, _, _, _ :: else -> break od

/* ---- the worker; after its death the same process is the next one ---- */
/* session.c is_too_early(), readers.c attach(): serves only returning clients until the writer has reported. */
#define HAS_REQUEST(c) (!hung_up[c] && \
                        ((store.back && len(request[c])) || (!store.back && request[c]?[_, OFFER, _, _])))
#ifdef FAULT_NOT_GATED
#define GATED(c) false
#elif defined FAULT_WRITER_IS_GATED
#define GATED(c) (store.behind[c] > notice)
#else
#define GATED(c) (c != WRITER && store.behind[c] > notice) /* is_noticed() */
#endif
#define SENDABLE(c) (store.count[c] && !hung_up[c] && len(said[c]) < ROOM && !GATED(c)) /* go_on() */
#ifdef FAULT_NOTICE_GOES_BACK
#define IS_NEWS(version) true
#else
#define IS_NEWS(version) ((version) > notice) /* the former worker's messages may be old */
#endif
#define LEFT_OVER(c) (hung_up[c] && (store.handled[c] || store.number[c]))

inline put(c, what) { /* client_send(), ddx_queue_put() */
    assert(store.count[c] < QUEUED_MAX);
    store.queue[c] = store.queue[c] | ((what) << (BITS * store.count[c]));
    store.count[c]++;
    store.number[c]++
}

inline announce(reader) { /* notify_reader() */
    store.announced++;
    assert(store.announced < VERSIONS);
    store.behind[reader] = store.announced;
    put(WRITER, READER(store.page[reader], store.announced))
#ifdef FAULT_NOTICE_BEFORE_READER
    ; notice = store.announced
#endif
}

inline work() { /* request_handle() */
    if
    :: operation == ATTACH -> /* reader_attach() */
        store.page[client] = first;
        store.share[client]++;
        announce(client);
        put(client, ANSWER)
    :: operation == OFFER && client == WRITER -> /* adopt_writer(), item_set_notice() */
        store.back = true;
        store.share[client] = second;
        store.announced = notice;
#ifndef FAULT_OFFER_WITHOUT_NOTICE
        store.announced = (first > notice -> first : notice); /* the previous store may have died before sent() */
#endif
        if :: second -> store.page[client] = OWN_PAGE; announce(client) :: else fi;
        if :: store.share[1] -> announce(1) :: else fi;
        if :: store.share[2] -> announce(2) :: else fi;
        put(client, OFFERED)
    :: operation == OFFER && client != WRITER -> /* adopt_reader() */
        store.page[client] = first;
        store.share[client] = second;
        if :: store.back -> announce(client) :: else fi;
        put(client, OFFERED)
    fi
}

#define COMMIT :: d_step { COPY(kept, store) } /* checkpoint_commit() */
#define OR_DIE \
    :: crashes < CRASHES -> goto next_worker \
    :: stores < DEATHS -> goto next_store

inline say(c) { /* ddx_send() */
    said[c]!store.number[c] - store.count[c] + 1, FIRST(c);
    any = true;
    to = c
}

active proctype worker() {
    byte client, number, operation, first, second; /* the client's request */
    byte to;
    bool any;

    d_step { /* the beginning: the writer's socket has unread messages */
        do
        :: store.number[WRITER] < UNREAD ->
            store.number[WRITER]++;
            said[WRITER]!store.number[WRITER], SLOT
        :: else -> break
        od;
        COPY(kept, store)
    }
turn:
end_turn:
    if /* store/main.c, hear() */
    :: atomic { HAS_REQUEST(0) -> client = 0 }
    :: atomic { HAS_REQUEST(1) -> client = 1 }
    :: atomic { HAS_REQUEST(2) -> client = 2 }
    :: SENDABLE(0) || SENDABLE(1) || SENDABLE(2) -> goto said_next
#if HANGUPS
    :: atomic { hangups < HANGUPS && !hung_up[1] && store.share[1] -> hangups++ }
        goto hang_up
    :: LEFT_OVER(1) -> goto hang_up
#endif
    OR_DIE
    fi;

    /* session.c client_receive() */
    atomic {
        request[client]?<number, operation, first, second>; /* ddx_peek() */
        if
#ifndef FAULT_HANDLED_TWICE
        :: number <= store.handled[client] -> goto discard
#endif
        :: else ->
            d_step {
                work();
                store.handled[client] = number
            }
        fi
    }
#ifdef FAULT_SAID_BEFORE_COMMIT
    goto said_next;
commit_late:
#endif
#ifndef FAULT_DISCARD_BEFORE_COMMIT
    if
    COMMIT
    OR_DIE
    fi;
#endif
discard:
    if
    :: atomic { /* ddx_discard() */
        request[client]?_, _, _, _ -> number = 0; operation = 0; first = 0; second = 0; client = 0
    }
    OR_DIE
    fi;
#ifdef FAULT_DISCARD_BEFORE_COMMIT
    if
    COMMIT
    OR_DIE
    fi;
#endif
#ifdef FAULT_SAID_BEFORE_COMMIT
    goto turn;
#endif

said_next: /* clients_go_on(), ddx_queue_go_on(); here in any order, and it may stop although there is room */
    if
    :: atomic { SENDABLE(0) -> say(0) }
    :: atomic { SENDABLE(1) -> say(1) }
    :: atomic { SENDABLE(2) -> say(2) }
    :: any || !(SENDABLE(0) || SENDABLE(1) || SENDABLE(2)) -> goto said_all
#ifdef FAULT_WAITS_FOR_ROOM
    :: store.count[WRITER] && len(said[WRITER]) == ROOM -> len(said[WRITER]) < ROOM
        goto said_next
#endif
    OR_DIE
    fi;
    if /* sent() */
    :: d_step {
        if
        :: to == WRITER && IS_READER(FIRST(to)) && IS_NEWS(VERSION(FIRST(to))) ->
            notice = VERSION(FIRST(to))
        :: else
        fi;
        store.queue[to] = store.queue[to] >> BITS;
        store.count[to]--;
        to = 0
    }
    OR_DIE
    fi;
    goto said_next;
said_all: /* files_commit(), clients_tell() */
#ifdef FAULT_SAID_BEFORE_COMMIT
    if
    :: operation -> any = false; goto commit_late
    :: else
    fi;
#endif
    if
    :: d_step { any = false; COPY(kept, store) }
    OR_DIE
    fi;
    goto turn;

#if HANGUPS
hang_up: /* refuse(), clients_sweep() */
#ifdef FAULT_HUNG_UP_AFTER_COMMIT
    if
    :: d_step { FORGET_CLIENT(store, 1); COPY(kept, store) }
    OR_DIE
    fi;
    if
    :: hung_up[1] = true
    OR_DIE
    fi;
#else
    if
    :: hung_up[1] = true /* first, or the next worker may reuse the descriptor for another client: files_sweep() */
    OR_DIE
    fi;
    if
    :: d_step { FORGET_CLIENT(store, 1); COPY(kept, store) }
    OR_DIE
    fi;
#endif
    goto turn;
#endif

next_worker: /* holder_run(), checkpoint_restore() */
    atomic {
        crashes++;
        number = 0; operation = 0; first = 0; second = 0; client = 0; to = 0; any = false;
        COPY(store, kept);
#ifdef FAULT_QUEUE_FORGOTTEN
        store.queue[0] = 0; store.queue[1] = 0; store.queue[2] = 0;
        store.count[0] = 0; store.count[1] = 0; store.count[2] = 0
#endif
    }
    goto turn;
next_store: /* the sockets are closed: clients can still read their messages, unread requests are lost */
    atomic {
        stores++;
        number = 0; operation = 0; first = 0; second = 0; client = 0; to = 0; any = false;
        store.back = false;
        store.announced = 0;
        FORGET_CLIENT(store, 0); FORGET_CLIENT(store, 1); FORGET_CLIENT(store, 2);
        COPY(kept, store);
        DRAIN(0); DRAIN(1); DRAIN(2);
        hung_up[1] = false
    }
    goto turn
}

/* ---- clients ---- */
#define ASKS_OF(c) (c == WRITER -> WRITER_ASKS : (c == 1 -> ASKS : SECOND))
#define CONNECTED(c) (own[c] == stores && !hung_up[c])
#ifdef FAULT_CLIENT_TAKES_TWICE
#define IS_OLD false
#else
#define IS_OLD (got <= heard)
#endif
#define STOP :: atomic { stops < STOPS -> stops++; stopped[me] = true; goto end_stopped }

inline take_in() { /* receive.c ddx_item_service(), handle() */
    said[me]?got, what;
    if
    :: IS_OLD -> what = SLOT
    :: else ->
        assert(got == heard + 1); /* each message once, and in order */
        heard = got
    fi;
    got = 0
}

inline ask(operation, value) { /* ddx_item_request(): one at a time */
    sent++;
    request[me]!sent, operation, value, 0;
    waits[me] = true
}

inline on_answer() {
    assert(waits[me]);
    waits[me] = false;
    answered[me]++;
    assert(!CONNECTED(me) || kept.share[me] == answered[me]) /* the request was handled, once, and is committed */
}

inline connect() { /* ddx_item_disconnect(), ddx_item_reconnect(): after all messages of the former store were read */
    own[me] = stores;
    hung_up[me] = false;
    DRAIN(me);
    heard = 0;
    sent = 0
}

active proctype writer() {
    byte me = WRITER;
    byte sent, heard, got, what;
    byte notice_seen;

end:
    do
    :: atomic { CONNECTED(me) && !waits[me] && answered[me] < ASKS_OF(me) -> ask(ATTACH, OWN_PAGE) }
    :: atomic { len(said[me]) ->
        take_in();
        if
        /* ddx_writer_on_reader() */
        :: IS_READER(what) -> notice_seen = VERSION(what); known = known | (1 << PAGE(what))
        :: what == ANSWER -> on_answer() /* ddx_reader_on_attached() */
        :: else
        fi;
        what = 0
    }
    :: d_step { answered[me] && !(pinned & (1 << OWN_PAGE)) -> pinned = pinned | (1 << OWN_PAGE) }
    :: atomic { !CONNECTED(me) && !len(said[me]) ->
        connect();
        waits[me] = false;
        sent = 1;
        request[me]!1, OFFER, notice_seen, answered[me]
    }
    /* ring.c ddx_ring_choose(): W3 sees no new version, W4 skips an unknown page, so that frame would be torn */
    :: d_step { notice <= notice_seen && (pinned & ~known) -> assert(!(pinned & ~known)) }
    /* writer.c choose(): W3 would see a new version for ever, and wait for the store */
    :: d_step { notice > notice_seen && !len(said[me]) && CONNECTED(me) -> assert(notice <= notice_seen) }
    STOP
    od;
end_stopped:
    false
}

active [2] proctype reader() {
    byte me = _pid - 1; /* after worker and writer */
    byte sent, heard, got, what;
    byte page = _pid - 2;

end:
    do
    :: atomic { CONNECTED(me) && !waits[me] && answered[me] < ASKS_OF(me) -> ask(ATTACH, page) }
    :: atomic { len(said[me]) ->
        take_in();
        if
        :: what == ANSWER -> on_answer()
        :: else
        fi;
        what = 0
    }
    :: atomic { !CONNECTED(me) && !len(said[me]) && !LEFT_OVER(me) ->
        connect();
        if
        :: answered[me] ->
            sent = 1;
            request[me]!1, OFFER, page, answered[me]
        :: else -> page = (waits[me] && page == 0 -> 2 : page) /* a new request gets another page; one more is enough */
        fi;
        waits[me] = false
    }
    :: d_step { answered[me] && !(pinned & (1 << page)) -> pinned = pinned | (1 << page) }
    STOP
    od;
end_stopped:
    false
}

/* When no process can step, each client has its answer, except readers if the writer is stopped. */
#define DONE(c) (stopped[c] || (c != WRITER && stopped[WRITER]) || \
                 (answered[c] == ASKS_OF(c) && kept.share[c] == answered[c]))

active proctype onlooker() {
end:
    timeout ->
    assert(DONE(0));
    assert(DONE(1));
    assert(DONE(2));
    assert(!store.back || (!len(request[0]) && !len(request[1]) && !len(request[2])))
}

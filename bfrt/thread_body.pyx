"""What a thread runs, from its first moment on: calls, one after another.

Python finds memory for a thread's stack when the first of its functions begins there. Where there
is none the thread ends before anything could catch that, whoever waits for it waits for ever, and a
traceback is printed. So the first is called from here, where that is caught.
"""

cdef extern from *:
    """
    #ifdef __linux__
    #ifndef _GNU_SOURCE
    #define _GNU_SOURCE
    #endif
    #include <pthread.h>
    #include <string.h>
    static void bfrt_name_thread(const char *name) {
        char cut[16] = {0};
        strncpy(cut, name, sizeof cut - 1);
        (void)pthread_setname_np(pthread_self(), cut);
    }
    #else
    static void bfrt_name_thread(const char *name) { (void)name; }
    #endif
    """
    void name_thread "bfrt_name_thread"(const char* name) noexcept nogil


def serve(bytes name, calls, told, first):
    """Be a thread: do `first`, tell that, and then calls until there is None.

    Parameters
    ----------
    name : bytes
        What the system calls the thread; 15 of them.
    calls : queue.SimpleQueue
        Gives functions without arguments, which raise nothing, and None to end.
    told : queue.SimpleQueue
        Gets None when `first` is done, or the exception that it raised; and None at the end.
    first : callable
        What needs a stack.
    """
    name_thread(name)
    try:
        first()
    except BaseException as error:
        told.put(error)
        return
    told.put(None)
    while True:
        call = calls.get()
        if call is None:
            break
        call()
        call = None
    told.put(None)

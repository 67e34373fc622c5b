"""The few atomic operations that threads share memory by (GCC's and Clang's builtins)."""

from libc.stdint cimport int64_t, uint8_t

cdef extern from *:
    """
    #include <stdint.h>
    static inline void bfrt_atomic_or(uint8_t *p, uint8_t bits) {
        if ((__atomic_load_n(p, __ATOMIC_RELAXED) & bits) != bits)
            __atomic_fetch_or(p, bits, __ATOMIC_RELAXED);
    }
    static inline void bfrt_atomic_add(int64_t *p, int64_t n) {
        __atomic_fetch_add(p, n, __ATOMIC_RELAXED);
    }
    static inline int64_t bfrt_atomic_fetch_add(int64_t *p, int64_t n) {
        return __atomic_fetch_add(p, n, __ATOMIC_RELAXED);
    }
    /* Sums of what is never negative: the order of additions cannot matter, the end neither. */
    static inline void bfrt_atomic_add_saturating(int64_t *p, int64_t n) {
        int64_t old = __atomic_load_n(p, __ATOMIC_RELAXED);
        int64_t sum;
        do {
            sum = old > INT64_MAX - n ? INT64_MAX : old + n;
        } while (!__atomic_compare_exchange_n(p, &old, sum, 1, __ATOMIC_RELAXED, __ATOMIC_RELAXED));
    }
    static inline int64_t bfrt_atomic_exchange(int64_t *p, int64_t n) {
        return __atomic_exchange_n(p, n, __ATOMIC_RELAXED);
    }
    static inline double bfrt_atomic_load(const void *p) {
        double x;
        __atomic_load((const double *)p, &x, __ATOMIC_RELAXED);
        return x;
    }
    /* A flag that says that what was written before it is there. */
    static inline void bfrt_publish(uint8_t *p) { __atomic_store_n(p, 1, __ATOMIC_RELEASE); }
    static inline int bfrt_published(const uint8_t *p) {
        return __atomic_load_n(p, __ATOMIC_ACQUIRE);
    }
    static inline void bfrt_lock(uint8_t *p) {
        while (__atomic_test_and_set(p, __ATOMIC_ACQUIRE)) {
            while (__atomic_load_n(p, __ATOMIC_RELAXED)) {}
        }
    }
    static inline void bfrt_unlock(uint8_t *p) { __atomic_clear(p, __ATOMIC_RELEASE); }
    """
    void atomic_or "bfrt_atomic_or"(uint8_t* p, uint8_t bits) noexcept nogil
    void atomic_add "bfrt_atomic_add"(int64_t* p, int64_t n) noexcept nogil
    int64_t atomic_fetch_add "bfrt_atomic_fetch_add"(int64_t* p, int64_t n) noexcept nogil
    void atomic_add_saturating "bfrt_atomic_add_saturating"(int64_t* p, int64_t n) noexcept nogil
    int64_t atomic_exchange "bfrt_atomic_exchange"(int64_t* p, int64_t n) noexcept nogil
    double atomic_load "bfrt_atomic_load"(const void* p) noexcept nogil
    void publish "bfrt_publish"(uint8_t* p) noexcept nogil
    bint published "bfrt_published"(const uint8_t* p) noexcept nogil
    void lock "bfrt_lock"(uint8_t* p) noexcept nogil
    void unlock "bfrt_unlock"(uint8_t* p) noexcept nogil

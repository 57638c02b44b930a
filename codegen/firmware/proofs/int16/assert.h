/* An assertion is a property to prove. */
#ifndef ASSERT_H
#define ASSERT_H

#define assert(condition) __CPROVER_assert(condition, #condition)

#endif

"""The store: samples on disk, written shard by shard, checked on reading."""

from tactileforge.packing.options import Filter as Filter
from tactileforge.packing.options import PackOptions as PackOptions
from tactileforge.packing.run import pack as pack
from tactileforge.packing.run import summary as summary

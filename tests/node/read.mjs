// What a reader of the web finds in a file, as JSON: node read.mjs FORMAT FILE
import { readFileSync } from 'node:fs'

const [format, file] = process.argv.slice(2)
const bytes = (path) => { const data = readFileSync(path); return data.buffer.slice(data.byteOffset, data.byteOffset + data.length) }

const readers = {
  async copc() {
    const { Copc } = (await import('copc')).default
    const cloud = await Copc.create(file)
    const { nodes } = await Copc.loadHierarchyPage(file, cloud.info.rootHierarchyPage)
    const names = ['X', 'Y', 'Z', 'GpsTime', 'Intensity', 'Classification', 'PointSourceId', ...cloud.eb.map((one) => one.name)]
    const found = Object.fromEntries(names.map((name) => [name, { least: Infinity, greatest: -Infinity, sum: 0 }]))
    let points = 0
    for (const node of Object.values(nodes)) {
      const view = await Copc.loadPointDataView(file, cloud, node)
      points += view.pointCount
      for (const [name, column] of Object.entries(found)) {
        const value = view.getter(name)
        for (let i = 0; i < view.pointCount; i++) {
          column.least = Math.min(column.least, value(i))
          column.greatest = Math.max(column.greatest, value(i))
          column.sum += value(i)
        }
      }
    }
    return { header: cloud.header, wkt: cloud.wkt, extra: cloud.eb, points, dimensions: found }
  },
  async geotiff() {
    const { fromFile } = await import('geotiff')
    const tiff = await fromFile(file)
    const image = await tiff.getImage()
    const bands = await image.readRasters()
    return {
      images: await tiff.getImageCount(), keys: image.getGeoKeys(), origin: image.getOrigin(), cell: image.getResolution(),
      rows: image.getHeight(), columns: image.getWidth(),
      bands: Array.from(bands, (band) => Array.from(band, (value) => Number.isFinite(value) ? value : null)),
    }
  },
  async geoparquet() {
    const { parquetMetadata, parquetReadObjects } = await import('hyparquet')
    const { compressors } = await import('hyparquet-compressors')
    const metadata = parquetMetadata(bytes(file))
    return {
      geo: JSON.parse(metadata.key_value_metadata.find((one) => one.key === 'geo').value),
      rows: await parquetReadObjects({ file: bytes(file), compressors }),
    }
  },
  async flatgeobuf() {
    const { deserialize } = await import('flatgeobuf/lib/mjs/geojson.js')
    let header
    const features = []
    for await (const one of deserialize(new Uint8Array(bytes(file)), { headerMetaFn: (found) => { header = found } })) features.push(one)
    return { crs: header.crs, features }
  },
  async shapefile() {
    const { read } = await import('shapefile')
    return read(file, undefined, { encoding: 'utf-8' })
  },
  async kml() {
    const { DOMParser } = await import('@xmldom/xmldom')
    const { kml } = await import('@tmcw/togeojson')
    return kml(new DOMParser().parseFromString(readFileSync(file, 'utf-8'), 'text/xml'))
  },
  async isoxml() {
    const { ISOXMLManager } = await import('isoxml')
    const manager = new ISOXMLManager()
    await manager.parseISOXMLFile(new Uint8Array(bytes(file)), 'application/zip')
    const { Partfield, Task } = manager.rootElement.attributes
    return {
      warnings: manager.getWarnings(),
      fields: Partfield.map((field) => field.attributes.PartfieldDesignator),
      tasks: Task.map((task) => ({
        name: task.attributes.TaskDesignator,
        logs: task.attributes.TimeLog.map((log) => log.parseBinaryFile().timeLogs),
      })),
    }
  },
}

const plain = (_, value) => {
  if (typeof value === 'bigint') return Number(value)
  if (value instanceof Uint8Array) return Buffer.from(value).toString('base64')
  return typeof value === 'number' && !Number.isFinite(value) ? null : value
}
process.stdout.write(JSON.stringify(await readers[format](), plain))

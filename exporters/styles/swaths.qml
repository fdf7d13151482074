<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Colour: difference of swaths, purple where a swath saw the ground higher than the one before it, orange where lower. -->
<qgis version="3.34.0" styleCategories="Symbology">
 <pipe>
  <provider>
   <resampling enabled="false" zoomedInResamplingMethod="nearestNeighbour" zoomedOutResamplingMethod="nearestNeighbour" maxOversampling="2"/>
  </provider>
  <rasterrenderer type="singlebandpseudocolor" band="1" alphaBand="-1" opacity="1" classificationMin="-0.02" classificationMax="0.02" nodataColor="">
   <rastershader>
    <colorrampshader colorRampType="INTERPOLATED" classificationMode="1" clip="0" minimumValue="-0.02" maximumValue="0.02" labelPrecision="3">
     <item value="-0.02" label="-20 mm" color="#b35806" alpha="255"/>
     <item value="-0.01" label="-10 mm" color="#fdb863" alpha="255"/>
     <item value="0" label="0 mm" color="#f7f7f7" alpha="255"/>
     <item value="0.01" label="10 mm" color="#b2abd2" alpha="255"/>
     <item value="0.02" label="20 mm" color="#542788" alpha="255"/>
    </colorrampshader>
   </rastershader>
  </rasterrenderer>
  <brightnesscontrast brightness="0" contrast="0" gamma="1"/>
  <huesaturation colorizeOn="0" saturation="0" grayscaleMode="0" invertColors="0"/>
  <rasterresampler maxOversampling="2"/>
  <resamplingStage>resamplingFilter</resamplingStage>
 </pipe>
 <blendMode>0</blendMode>
</qgis>
